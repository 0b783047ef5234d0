"""The eight regions of a head: which triangle belongs to which."""
