"""Evidence about an asset: clauses measured one by one, and a verdict."""
