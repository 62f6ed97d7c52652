"""Place parts where an image shows them."""
