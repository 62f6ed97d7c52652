"""Actors: estimate the joints of an object from video, images or text."""
