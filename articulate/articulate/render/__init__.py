"""Pictures without a screen: where MuJoCo draws, and where a camera stands."""
