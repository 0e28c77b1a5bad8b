"""What is stated of a measurement: one model, its rules, and the capture that it describes."""
