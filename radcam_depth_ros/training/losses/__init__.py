"""Losses: one module for each network, and terms that several of them share."""
