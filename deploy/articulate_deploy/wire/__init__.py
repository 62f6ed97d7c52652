"""Simulated robot that serves Franka's control interface (FCI) over TCP and UDP.

Unmodified clients (panda-python, franka-rs, pylibfranka, franky) connect to it on a loopback
address. Start it from a test::

    from articulate_deploy.wire import SimulatedArm

    with SimulatedArm(bundle_path, "127.0.0.2", protocol=5) as arm:
        ...                     # connect a client to 127.0.0.2
        arm.object_state()      # true state of the object
        arm.reset_to(q, width)  # between two motions

``SimulatedArm(None, ...)`` is a bare arm without an object, which needs no MuJoCo.
"""

from articulate_deploy.wire.simulated_arm import SimulatedArm

__all__ = ["SimulatedArm"]
