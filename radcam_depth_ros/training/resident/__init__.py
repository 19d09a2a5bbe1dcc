"""Samples that are held in the device's memory, and their augmentation there: a GPU does not wait for the host."""
