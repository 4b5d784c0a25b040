"""The subcommands of `ssil-data`, as functions whose parameters are the command line."""
