"""Light transport traced once, as a polynomial in the reflectances."""
