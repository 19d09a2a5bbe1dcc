"""How good depth images are: measures, what geometry alone gives, and a report to look at."""
