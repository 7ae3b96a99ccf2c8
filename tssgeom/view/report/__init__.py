"""Pages of HTML: the report of a batch, and what `discover` found."""
