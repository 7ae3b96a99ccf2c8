"""Pages of HTML: the report of a batch, and that of `discover`."""
