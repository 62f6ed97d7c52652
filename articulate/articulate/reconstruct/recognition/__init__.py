"""Object mask and category of an image, by networks whose weights come with packages."""
