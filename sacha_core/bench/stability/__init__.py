"""Hard cases, each with what must happen and code that looks whether it does."""
