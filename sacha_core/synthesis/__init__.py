"""Multi-view captures made from a head that nobody had to film."""
