"""Find joints in videos by fitting a rendered model to the frames."""
