"""The subcommands of `iswarm`, one a file."""
