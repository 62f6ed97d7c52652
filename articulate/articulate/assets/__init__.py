"""Assets: links, joints, handles, the asset folder and its check report."""
