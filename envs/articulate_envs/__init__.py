"""Scenes and engines; importing it registers the Gymnasium ids ``Articulate/...-v0``."""

from articulate_envs.registration import register_with_gymnasium

register_with_gymnasium()
