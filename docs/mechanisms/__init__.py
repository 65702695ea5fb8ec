"""The page of the catalogued mechanisms: what they are, and the evidence that they could be built."""
