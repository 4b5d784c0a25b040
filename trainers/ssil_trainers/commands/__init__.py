"""The subcommands `collect`, `train` and `evaluate`; a function's parameters are the flags."""
