"""What a measurement found, in one record that every page, file and command lays out."""
