"""Many drives on many machines: shards, results by content, merging, and the engines that run them."""
