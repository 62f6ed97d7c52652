"""Actors and a critic that use a vision-language model over a network.

::

    Evidence ─► Request (text, images, JSON schema) ─► Model ─► typed answer ─► Prediction
                                 ▲                                   │
                                 └── errors of the answer or of its program ◄──┘

Requests are written in the provider's documented JSON and sent with httpx. Client libraries of the
providers are not used: their retries, added prompts and imports differ, while one implementation
gives the same retries, budget and hash of a request for all. A provider is a class with the
protocol :class:`wire_format.WireFormat`; any other model is one with :class:`model.Model`. Answers
are frozen dataclasses: their JSON schema is part of the request, and answers are decoded like
configuration (:mod:`articulate.config`). A dry run therefore needs no package.
"""
