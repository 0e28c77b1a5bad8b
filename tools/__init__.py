"""Scripts that make what ships with the program; the program imports none of them."""
