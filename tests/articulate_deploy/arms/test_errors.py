import pytest

from articulate_deploy.arms.errors import (
    ArmUnreachableError,
    CommandRejectedError,
    CommunicationLostError,
    ReflexError,
    UserStopError,
    VersionMismatchError,
    arm_error,
)

TEXTS = {
    "libfranka: Connection to FCI refu" "sed. Please install FCI feature": ArmUnreachableError,
    "libfranka: Incompatible library version (server version: 7, library version: 5). Please":
        VersionMismatchError,
    "Incompatible library version (server version: 10, library version: 5)": VersionMismatchError,
    'libfranka: Move command aborted: motion aborted by reflex! ["cartesian_reflex"]': ReflexError,
    "libfranka: Move command aborted: User Stop pressed!": UserStopError,
    'libfranka: Set Joint Impedance command rejected: command not possible in the current mode '
    '("User stopped")!': UserStopError,
    "libfranka: UDP receive: Timeout": CommunicationLostError,
    "libfranka: TCP connection got interrupted.": CommunicationLostError,
    'motion aborted by reflex! ["communication_constraints_violation"]': CommunicationLostError,
    "libfranka: Set Collision Behavior command rejected: invalid argument": CommandRejectedError,
    "libfranka: server closed connection": CommunicationLostError,
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
def test_texts_of_clients_become_typed_errors(text, error_line):
    error = arm_error(text, "172.16.0.2")
    assert type(error) is TEXTS[text]

    def fail() -> None:
        raise error

    error_line(f"arm_error({text[:60]})", fail)


def test_the_version_names_robot_package_and_command():
    text = str(arm_error("Incompatible library version (server version: 10)", "172.16.0.2"))
    assert "FR3, system 5.9.0 or later" in text
    assert 'pip install "articulate-robots[deploy-fr3]"' in text
    assert "pylibfranka" in text
