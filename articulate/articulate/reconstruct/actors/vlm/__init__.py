"""Actors and a critic that ask a vision-language model over a network.

::

    Evidence ─► Request (words, pictures, JSON schema) ─► Model ─► typed answer ─► Prediction
                                 ▲                                     │
                                 └── what does not fit, where a program broke a rule ◄─┘

Models are Google's Gemini, spoken to by ``google-genai`` itself and not through pydantic-ai: the
layer prepends a paragraph of its own to what a model is told, so that a dry run would not show the
exact prompt and a kept answer would hang on the layer's version; it retries in ways of its own; and
it takes a second to import. What it adds, other providers, is a :class:`model.Model` here. Answers
are frozen dataclasses: their JSON schema goes out, and what comes back is decoded as configuration
is (:mod:`articulate.config`). So a dry run needs no package at all.
"""
