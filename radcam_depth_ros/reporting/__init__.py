"""Pages, tables, plots and pictures of results."""
