"""Measurements that anyone can repeat: run time against error, growth of cost, and numerical stability."""
