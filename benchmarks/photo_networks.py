"""Train the networks that read photos: box and front of an object.

    python benchmarks/photo_networks.py --samples FOLDER --network box --epochs 10 --out FILE.npz

Samples are those of ``benchmarks/photo_samples.py``. The networks read features of the ImageNet
network, which stay fixed. Every tenth object is held out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from articulate.reconstruct.fitting import front_network
from articulate.reconstruct.fitting.box_network import GRID, GRID_HIGH, GRID_LOW
from articulate.transforms import Array, Ints

HELD_OUT = 10
"""One object in so many is held out."""
BATCH = 32
RATE = 3e-3
Loss = Callable[[Any, dict[str, Tensor]], tuple[Tensor, dict[str, float]]]
ENTRIES = {
    "box": ("stride_16", "stride_32", "corners", "sizes", "view"),
    "front": (
        "front_stride_8",
        "front_stride_16",
        "front_stride_32",
        "front_parts",
        "front_aspect",
    ),
}
"""Entries of the samples that each network reads."""


class Layer(nn.Module):
    """Convolution, batch normalization and rectifier."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self.norm = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """Return the map (N, C, H, W) of a map."""
        out: Tensor = functional.relu(self.norm(self.convolution(x)))
        return out


class Decoder(nn.Module):
    """Map at 14 x 14 from inner features at 7 and 14, and a global vector."""

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.in_32, self.mid_32 = Layer(320, coarse, 1), Layer(coarse, coarse)
        self.context = nn.Linear(coarse, coarse)
        self.in_16, self.mid_16 = Layer(112, fine, 1), Layer(coarse + fine, fine)

    def forward(self, maps: list[Tensor]) -> tuple[Tensor, Tensor]:
        """Return the map and the vector."""
        x = self.mid_32(self.in_32(maps[1]))
        context = functional.relu(self.context(x.mean(dim=(2, 3))))
        x = x + context[:, :, None, None]
        x = torch.cat([functional.interpolate(x, scale_factor=2.0), self.in_16(maps[0])], 1)
        return self.mid_16(x), context


class BoxNetwork(nn.Module):
    """Heat maps of the corners (N, 8, 14, 14) and means and log spreads of sizes and view."""

    def __init__(self) -> None:
        super().__init__()
        self.decoder = Decoder(96, 64)
        self.heat = nn.Conv2d(64, 8, 3, padding=1)
        self.spread = nn.Linear(96, 8)
        self.hidden = nn.Linear(96, 64)
        self.values = nn.Linear(64, 10)

    def forward(self, maps: list[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Return heat maps, log spreads of the corners, and values with their log spreads."""
        x, context = self.decoder(maps)
        return (
            self.heat(x),
            self.spread(context),
            self.values(functional.relu(self.hidden(context))),
        )


def corner_moments(heat: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean (N, 8, 2) and variance (N, 8, 2) of heat maps, in shares of the crop."""
    p = functional.softmax(heat.flatten(2), dim=2).view(heat.shape)
    grid = torch.linspace(GRID_LOW, GRID_HIGH, GRID)
    across, down = p.sum(dim=2), p.sum(dim=3)
    mean = torch.stack([(across * grid).sum(-1), (down * grid).sum(-1)], -1)
    square = torch.stack([(across * grid**2).sum(-1), (down * grid**2).sum(-1)], -1)
    return mean, square - mean**2


class FrontNetwork(nn.Module):
    """Logits of the kinds and of the distances to the edges of a part (N, 9, 28, 28)."""

    def __init__(self) -> None:
        super().__init__()
        self.decoder = Decoder(96, 48)
        self.in_8 = Layer(40, 32, 1)
        self.join, self.last = Layer(48 + 32 + 1, 48), Layer(48, 48)
        self.out = nn.Conv2d(48, len(front_network.KINDS) + 4, 3, padding=1)

    def forward(self, maps: list[Tensor], aspect: Tensor) -> Tensor:
        """Return the logits."""
        coarse, _ = self.decoder(maps[1:])
        fine = self.in_8(maps[0])
        plane = aspect[:, None, None, None].expand(-1, 1, *fine.shape[2:])
        x = torch.cat([functional.interpolate(coarse, scale_factor=2.0), fine, plane], 1)
        out: Tensor = self.out(self.last(self.join(x)))
        return out


def front_truth(parts: Tensor) -> tuple[Tensor, Tensor]:
    """Return the kind (N, 784) and the distances to the edges (N, 784, 4) at each point.

    Args:
        parts: Left, top, right, bottom and kind (N, M, 5); kind 0: none.
    """
    at = torch.from_numpy(front_network.points().astype(np.float32))
    u, v = at[:, 0, None], at[:, 1, None]
    left, top, right, bottom, kind = (parts[:, None, :, k] for k in range(5))
    distances = torch.stack([u - left, right - u, v - top, bottom - v], -1)  # (N, 784, M, 4)
    inside = (distances.min(dim=-1).values > 0.0) & (kind > 0.0)
    which = inside.float().argmax(dim=2, keepdim=True)
    found = torch.gather(kind.expand(inside.shape), 2, which) * torch.gather(inside, 2, which)
    reach = torch.gather(distances, 2, which[..., None].expand(-1, -1, -1, 4))
    return found[..., 0].long(), reach[:, :, 0]


def front_loss(network: FrontNetwork, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, float]]:
    """Return the cross-entropy of the kinds and the loss of the rectangles (UnitBox, Yu 2016)."""
    out = network([batch[name] for name in ENTRIES["front"][:3]], batch["front_aspect"]).flatten(2)
    kinds = len(front_network.KINDS)
    kind, reach = front_truth(batch["front_parts"])
    loss = functional.cross_entropy(out[:, :kinds], kind)
    on = kind > 0
    true, found = reach[on], torch.sigmoid(out[:, kinds:].transpose(1, 2)[on])
    least = torch.minimum(true, found)
    both = (least[:, 0] + least[:, 1]) * (least[:, 2] + least[:, 3])
    areas = [(r[:, 0] + r[:, 1]) * (r[:, 2] + r[:, 3]) for r in (true, found)]
    share = both / (areas[0] + areas[1] - both).clamp(min=1e-6)
    weight = areas[0].clamp(min=1e-3) ** -0.5  # small parts count too
    loss = loss + (-torch.log(share.clamp(min=1e-3)) * weight).sum() / weight.sum()
    right = (out[:, :kinds].argmax(dim=1) == kind).float()
    figures = {"kinds": float(right.mean()), "overlap": float(share.detach().mean())}
    return loss, figures


def box_loss(network: BoxNetwork, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, float]]:
    """Return the negative log-likelihood of corners, sizes and view."""
    heat, log_spread, values = network([batch["stride_16"], batch["stride_32"]])
    mean, variance = corner_moments(heat)
    error = batch["corners"].clamp(0.0, 1.0) - mean
    spread = torch.exp(log_spread.clamp(-4, 2) - 3.0)[..., None]
    loss = (error.abs() / spread + torch.log(spread)).mean()  # Laplace: robust to mistaken fronts
    loss = loss + 3.0 * variance.mean()
    truth = torch.cat([batch["sizes"], batch["view"]], 1)
    miss = truth - values[:, :5]
    log_sigma = values[:, 5:].clamp(-4, 1)
    loss = loss + 0.3 * (0.5 * (miss / torch.exp(log_sigma)) ** 2 + log_sigma).mean()
    figures = {
        "corner": float(error.detach().norm(dim=-1).mean()),
        "corner_median": float(error.detach().norm(dim=-1).median()),
        "width": float(miss[:, 0].detach().abs().mean()),
        "depth": float(miss[:, 1].detach().abs().mean()),
        "azimuth": float(miss[:, 2].detach().abs().mean()),
    }
    return loss, figures


def load(folder: Path, kind: str) -> tuple[dict[str, Array], Ints]:
    """Return the entries of the samples for a network and the number of the object of each."""
    arrays: dict[str, list[Array]] = {name: [] for name in ENTRIES[kind]}
    objects: list[Ints] = []
    for path in sorted(folder.glob("*.npz")):
        with np.load(path, allow_pickle=False) as file:
            objects.append(file["front_object" if kind == "front" else "object"])
            for name, found in arrays.items():
                found.append(file[name])
    return {name: np.concatenate(a) for name, a in arrays.items()}, np.concatenate(objects)


def tensors(arrays: dict[str, Array], index: Ints) -> dict[str, Tensor]:
    """Return a batch."""
    return {name: torch.from_numpy(v[index]).float() for name, v in arrays.items()}


def train(
    network: Any, loss_of: Loss, arrays: dict[str, Array], objects: Ints, epochs: int
) -> None:
    """Train with a one-cycle rate and print the held-out figures."""
    held = objects % HELD_OUT == 0
    index, test = np.flatnonzero(~held), np.flatnonzero(held)
    rng = np.random.default_rng(0)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-2)
    steps = epochs * (len(index) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps + 1)
    for epoch in range(epochs):
        losses = []
        network.train()
        order = rng.permutation(index)
        for k in range(len(index) // BATCH):
            loss, _ = loss_of(network, tensors(arrays, order[k * BATCH : (k + 1) * BATCH]))
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            losses.append(float(loss.detach()))
        network.eval()
        with torch.no_grad():
            found = [
                loss_of(network, tensors(arrays, test[k : k + 64]))[1]
                for k in range(0, len(test), 64)
            ]
        figures = {n: round(float(np.mean([one[n] for one in found])), 4) for n in found[0]}
        sys.stderr.write(f"epoch {epoch}: {np.mean(losses):.4f}, held out {figures}\n")


def folded(network: nn.Module) -> dict[str, Any]:
    """Return the weights with the batch normalization folded in, in half precision."""
    out: dict[str, Any] = {}
    for name, module in network.named_modules():
        if isinstance(module, Layer):
            norm = module.norm
            assert norm.running_var is not None
            assert norm.running_mean is not None
            gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
            out[f"{name}.weight"] = module.convolution.weight * gain[:, None, None, None]
            out[f"{name}.bias"] = norm.bias - gain * norm.running_mean
        elif isinstance(module, nn.Linear) or (
            isinstance(module, nn.Conv2d) and not name.endswith(".convolution")
        ):
            out[f"{name}.weight"], out[f"{name}.bias"] = module.weight, module.bias
    return {name: value.detach().numpy().astype(np.float16) for name, value in out.items()}


def main() -> None:
    """Train a network and write its weights."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--samples", type=Path, required=True)
    parser.add_argument("--network", choices=sorted(ENTRIES), required=True)
    parser.add_argument("--epochs", type=int, default=9)
    parser.add_argument("--out", type=Path, required=True)
    flags = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(1)
    arrays, objects = load(flags.samples, flags.network)
    network = BoxNetwork() if flags.network == "box" else FrontNetwork()
    loss: Loss = box_loss if flags.network == "box" else front_loss
    train(network, loss, arrays, objects, flags.epochs)
    np.savez_compressed(flags.out, **folded(network))


if __name__ == "__main__":
    main()
