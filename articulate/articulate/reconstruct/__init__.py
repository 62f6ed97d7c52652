"""Making: from a clip, a picture or a sentence, and parts, to an object that is proven."""
