"""When the weight η of the state reward becomes smaller."""

from __future__ import annotations


def decay_eta(eta: float, decay: float, *, rise_d: float, rise_c: float) -> float:
    """Return η for the next iteration: ε·η if V_D rose more than V_C, else η as it was.

    As the policy becomes better by the discriminator's reward, the state reward counts less.

    Parameters
    ----------
    eta:
        η so far.
    decay:
        ε, from 0 to 1.
    rise_d:
        ΔV_D, how much the first critic's mean value at the initial states rose.
    rise_c:
        ΔV_C, the same of the critic of the state reward, not centered.

    Notes
    -----
    Source: line 8 of Algorithm 1 of the SSIL paper.

    Examples
    --------
    >>> decay_eta(1.0, 0.9, rise_d=0.2, rise_c=0.1), decay_eta(1.0, 0.9, rise_d=0.1, rise_c=0.2)
    (0.9, 1.0)
    """
    return decay * eta if rise_d > rise_c else eta
