"""Checks of assets: each measures one property and reads the asset only."""
