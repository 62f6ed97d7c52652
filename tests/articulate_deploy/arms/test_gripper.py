import time

from articulate.robot.arm import PANDA
from articulate_deploy.arms.clients.fake import FakeGripper
from articulate_deploy.arms.gripper import CLOSE, OPEN, GripperWorker


def test_it_closes_by_grasp_and_opens_by_move():
    client = FakeGripper()
    worker = GripperWorker(client, PANDA.gripper)
    for command in (CLOSE, OPEN):
        worker.request(command)
        assert worker.finish(5.0)
    worker.close()
    assert client.calls == ["grasp", "move"]


def test_equal_commands_are_dropped():
    client = FakeGripper()
    worker = GripperWorker(client, PANDA.gripper)
    for _ in range(3):
        worker.request(CLOSE)
        assert worker.finish(5.0)
    worker.close()
    assert client.calls == ["grasp"]


def test_the_last_of_several_requests_wins():
    client = FakeGripper(seconds=0.3)
    worker = GripperWorker(client, PANDA.gripper)
    worker.request(CLOSE)
    time.sleep(0.1)
    for command in (OPEN, CLOSE, OPEN):
        worker.request(command)
    assert worker.finish(5.0)
    worker.close()
    assert client.calls == ["grasp", "move"]


def test_a_failed_command_is_kept_and_may_be_repeated():
    class Failing(FakeGripper):
        def grasp(self, *arguments: float) -> bool:
            raise RuntimeError("gripper: grasp failed")

    worker = GripperWorker(Failing(), PANDA.gripper)
    worker.request(CLOSE)
    assert worker.finish(5.0)
    assert str(worker.error) == "gripper: grasp failed"
    worker.request(CLOSE)
    assert worker.finish(5.0)
    worker.close()
    assert worker.commands == [CLOSE, CLOSE]
