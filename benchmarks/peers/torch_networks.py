"""The network as PyTorch users write it, and its training step: what benchmarks compare with."""

from itertools import pairwise

import numpy as np
import torch
from torch import nn

from jaxmm.config import Config, NetworkConfig
from jaxmm.learning.batches import Batch
from warp_scanner.cores import core_count


class PointNetwork(nn.Module):
    """Convolutions of kernel 1, the summary repeated and concatenated; clouds (B, F, N) to logits (B, N)."""

    def __init__(self, network: NetworkConfig):
        super().__init__()
        widths = [1, *network.encoder]
        last = len(widths) - 2
        blocks = [block(a, b, network.dropout * (i == last)) for i, (a, b) in enumerate(pairwise(widths))]
        self.encoder = nn.Sequential(*(layer for layers in blocks for layer in layers))
        blocks = [block(a, b, network.dropout) for a, b in pairwise([2 * network.encoder[-1], *network.head])]
        self.head = nn.Sequential(*(layer for layers in blocks for layer in layers), nn.Conv1d(network.head[-1], 1, 1))

    def forward(self, x):
        x = self.encoder(x)
        summary = x.max(2, keepdim=True)[0].expand(-1, -1, x.shape[2])
        return self.head(torch.cat([x, summary], 1))[:, 0]


def block(inputs: int, outputs: int, dropout: float) -> list[nn.Module]:
    """One layer with its normalisation, and dropout where there is any."""
    layers = [nn.Conv1d(inputs, outputs, 1), nn.BatchNorm1d(outputs), nn.ReLU()]
    return layers + [nn.Dropout(dropout)] * (dropout > 0)


def torch_step(batch: Batch, config: Config, compiled: bool):
    """A function that trains as many networks as the batch has scenarios by one step each, one after the other."""
    torch.set_num_threads(core_count())
    models = [PointNetwork(config.network) for _ in batch.features]
    adams = [
        torch.optim.Adam(model.parameters(), config.train.learning_rate, weight_decay=config.train.weight_decay)
        for model in models
    ]
    features = [torch.from_numpy(np.ascontiguousarray(clouds.transpose(0, 2, 1))) for clouds in batch.features]
    labels = [torch.from_numpy(clouds.astype(np.float32)) for clouds in batch.labels]

    def loss_of(model, x, y):
        entropy = nn.functional.binary_cross_entropy_with_logits(model(x), y, reduction="none")
        return (config.loss.alpha * (1 - torch.exp(-entropy)) ** config.loss.gamma * entropy).mean()

    losses = [torch.compile(loss_of) if compiled else loss_of for _ in models]

    def step():
        for loss, model, adam, x, y in zip(losses, models, adams, features, labels, strict=True):
            adam.zero_grad()
            loss(model, x, y).backward()
            adam.step()

    return step
