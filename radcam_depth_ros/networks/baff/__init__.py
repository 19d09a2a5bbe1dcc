"""`baff` and its baseline: radar-pixel association, bidirectional fusion and parallel attention."""
