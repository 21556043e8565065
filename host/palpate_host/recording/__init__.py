"""What a hand did, for other tools: MCAP, CSV, Parquet."""
