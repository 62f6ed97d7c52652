"""Scenes and engines; importing it makes the ids ``Articulate/...-v0`` known to gymnasium."""

from articulate_envs.registration import register_with_gymnasium

register_with_gymnasium()
