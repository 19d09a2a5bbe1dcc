"""Training in several processes: ranks, shared gradients, batch norms over all of them."""
