"""Layers that several networks share: convolutional blocks, backbones, radar as image planes, the flat road."""
