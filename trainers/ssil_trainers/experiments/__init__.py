"""The paper's tables, run again: cells, their statistics, the ledger of claims, one page."""
