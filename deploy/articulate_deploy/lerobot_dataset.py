"""Recordings as a LeRobot dataset v3.0: Parquet and JSON, without videos."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import MissingError, UsageError
from articulate.files import write_json
from articulate.transforms import Array
from articulate_deploy.recorded_episodes import RecordedDeployment, RecordedEpisode
from articulate_deploy.robots.robot import GRIPPER_KEY, JOINT_KEYS, SPEED_KEYS

VERSION = "v3.0"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
STATE_NAMES = (*JOINT_KEYS, *SPEED_KEYS, GRIPPER_KEY)
"""Names of ``observation.state``, the robot's keys."""
ACTION_NAMES = (*JOINT_KEYS, GRIPPER_KEY)
"""Names of ``action``: targets [rad] and the opening of the gripper [m]."""
ENVIRONMENT_NAMES = ("part.open", "force.x", "force.y", "force.z")
"""Names of ``observation.environment_state``: estimated fraction open, measured force [N]."""
INTEGERS = ("frame_index", "episode_index", "index", "task_index")
ROBOT_TYPE = "articulate"


def write_lerobot_dataset(deployment: RecordedDeployment, out: Path, *, task: str) -> Path:
    """Write the recording as a dataset in the new folder ``out``.

    Args:
        deployment: Recording.
        out: Folder that does not exist.
        task: Description of the task.

    Raises:
        MissingError: pyarrow is not installed.
        UsageError: ``out`` exists.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise MissingError(
            "LeRobot datasets need pyarrow, which is not installed; run: "
            'pip install "articulate-robots[lerobot]"'
        ) from None
    if out.exists():
        raise UsageError(f"{out}: exists; choose another --out")
    tables = [_table(episode, k) for k, episode in enumerate(deployment.episodes)]
    begins = np.cumsum([0, *(len(t["index"]) for t in tables)])
    for table, begin in zip(tables, begins, strict=False):
        table["index"] = table["index"] + begin

    def write(path: Path, columns: dict[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pyarrow.table(columns), path)

    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as temporary:
        folder = Path(temporary) / "dataset"
        write(folder / DATA.format(chunk_index=0, file_index=0), _joined(pyarrow, tables))
        write(
            folder / EPISODES.format(chunk_index=0, file_index=0), _episodes(tables, begins, task)
        )
        write(folder / "meta/tasks.parquet", {
            "task_index": pyarrow.array([0], pyarrow.int64()), "__index_level_0__": [task],
        })  # fmt: skip
        write_json(folder / "meta/stats.json", _statistics(tables))
        write_json(folder / "meta/info.json", _info(deployment, tables, int(begins[-1])))
        folder.rename(out)
    return out


def _table(episode: RecordedEpisode, k: int) -> dict[str, Any]:
    """Return the columns of one episode; ``index`` begins at 0."""
    a = episode.arrays
    n, width = len(a["time_s"]), a["gripper_width_m"][:, None]
    force = a.get("measured_force_n", np.zeros((n, 3)))
    opened = a.get("estimate_open", np.zeros(n))
    closing = a["action"][:, 7:] > 0.0
    done = np.zeros(n, dtype=bool)
    done[-1:] = True
    success = episode.result.get("reason") == "success"
    return {
        "observation.state": np.hstack([a["joint_pos"], a["joint_vel"], width]).astype("f4"),
        "observation.environment_state": np.hstack([opened[:, None], force]).astype("f4"),
        "action": np.hstack([a["target"], np.where(closing, 0.0, 0.08)]).astype("f4"),
        "timestamp": (a["time_s"] - a["time_s"][:1]).astype("f4"),
        "next.reward": (done & success).astype("f4"),
        "next.done": done,
        "next.success": done & success,
        "frame_index": np.arange(n),
        "episode_index": np.full(n, k),
        "index": np.arange(n),
        "task_index": np.zeros(n, dtype=np.int64),
    }


def _joined(pyarrow: Any, tables: list[dict[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name in tables[0]:
        values = np.concatenate([table[name] for table in tables])
        if values.ndim == 2:
            flat = pyarrow.array(values.reshape(-1), pyarrow.float32())
            out[name] = pyarrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
        else:
            out[name] = pyarrow.array(values)
    return out


def _episodes(tables: list[dict[str, Any]], begins: Array, task: str) -> dict[str, Any]:
    n = len(tables)
    zeros = [0] * n
    out: dict[str, Any] = {
        "episode_index": list(range(n)),
        "tasks": [[task]] * n,
        "length": [len(t["index"]) for t in tables],
        "dataset_from_index": begins[:-1].tolist(),
        "dataset_to_index": begins[1:].tolist(),
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }
    for name in tables[0]:
        each = [_stats(table[name]) for table in tables]
        for key in each[0]:
            out[f"stats/{name}/{key}"] = [stats[key] for stats in each]
    return out


def _stats(values: Array) -> dict[str, list[float]]:
    table = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    return {
        "min": table.min(axis=0).tolist(),
        "max": table.max(axis=0).tolist(),
        "mean": table.mean(axis=0).tolist(),
        "std": table.std(axis=0).tolist(),
        "count": [float(len(table))],
    }


def _statistics(tables: list[dict[str, Any]]) -> dict[str, Any]:
    return {name: _stats(np.concatenate([t[name] for t in tables])) for name in tables[0]}


def _info(deployment: RecordedDeployment, tables: list[dict[str, Any]], total: int) -> Any:
    times = tables[0]["timestamp"]
    fps = round(1.0 / float(np.median(np.diff(times)))) if len(times) > 1 else 20
    names = {
        "observation.state": list(STATE_NAMES),
        "observation.environment_state": list(ENVIRONMENT_NAMES),
        "action": list(ACTION_NAMES),
    }
    features = {
        name: {
            "dtype": "int64" if name in INTEGERS else str(values.dtype),
            "shape": [values.shape[1] if values.ndim == 2 else 1],
            "names": names.get(name),
        }
        for name, values in tables[0].items()
    }
    return {
        "codebase_version": VERSION,
        "robot_type": f"{ROBOT_TYPE}_{deployment.report.get('robot', 'robot')}",
        "total_episodes": len(tables),
        "total_frames": total,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(tables)}"},
        "data_path": DATA,
        "video_path": VIDEO,
        "features": features,
    }
