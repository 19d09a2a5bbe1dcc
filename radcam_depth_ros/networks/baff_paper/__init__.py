"""`baff_paper`: the paper's own form of `baff`, the reference of its speed."""
