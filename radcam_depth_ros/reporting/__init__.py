"""Pages, tables, plots and pictures of results; numbers come from the rooms above."""
