"""Actors: from a clip, a picture or a sentence to the joints of an object."""
