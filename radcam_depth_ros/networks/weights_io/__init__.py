"""Weight files: safetensors with a card, exported TorchScript, and the check of what an exported file holds."""
