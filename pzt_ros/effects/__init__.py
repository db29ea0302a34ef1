"""Effects: optional links of the signal chain, one file each, one entry in `table`."""
