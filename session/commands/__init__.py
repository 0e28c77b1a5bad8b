"""The commands of spectrabox, one file a subject; heavy modules are imported inside them."""
