"""Weight files: safetensors with a card, TorchScript exports, and the check of what an exported file holds."""
