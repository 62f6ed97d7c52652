"""Actors and a critic that use a vision-language model over a network.

::

    Evidence ─► Request (text, images, JSON schema) ─► Model ─► typed answer ─► Prediction
                                 ▲                                   │
                                 └── errors of the answer or of its program ◄──┘

Models are Google's Gemini, used through ``google-genai`` directly and not through pydantic-ai.
That layer prepends text to the prompt, so that a dry run would not show the exact prompt and cached
answers would depend on the layer's version; it has its own retries; and its import takes a second.
Another provider is a class with the protocol :class:`model.Model`. Answers are frozen dataclasses:
their JSON schema is part of the request, and answers are decoded like configuration
(:mod:`articulate.config`). A dry run therefore needs no package.
"""
