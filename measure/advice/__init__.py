"""What to do next: actions ranked by what the product itself expects of them."""
