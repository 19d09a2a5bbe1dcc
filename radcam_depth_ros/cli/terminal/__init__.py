"""Options, tables and requests that the verbs share."""
