"""Training data: prepared samples on disk, augmentation, batches and their order."""
