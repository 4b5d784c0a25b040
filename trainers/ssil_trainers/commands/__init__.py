"""The subcommands `collect`, `train` and `evaluate`, as functions whose parameters are the flags."""
