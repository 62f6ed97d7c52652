"""Parts and joints of one unsegmented mesh."""
