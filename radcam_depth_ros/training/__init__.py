"""Training: samples from bags, augmentation, losses and the loop that fits a network."""
