"""The paper's tables, run again: cells, their statistics, verdicts on the claims, one page."""
