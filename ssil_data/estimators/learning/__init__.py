"""Where torch lives: imported by `fit` alone, so that settings and scoring never wait for it."""
