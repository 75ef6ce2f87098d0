"""The rows of `splatweaver bench engine`, timed with PyTorch: one JSON object of milliseconds by row.

Usage: pytorch.py THREADS RUNS

A figure is the median of RUNS rounds; a round repeats the work for at least 50 ms.
"""

import json
import statistics
import sys
import time

import torch
from torch import nn
from torch.nn import functional

LEAST_SECONDS = 0.05


class Block(nn.Module):
    """A transformer block with the norms first, hidden width four times the width."""

    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.norms = nn.ModuleList(nn.LayerNorm(width, eps=1e-6) for _ in range(2))
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.wide, self.narrow = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x):
        batch, tokens, width = x.shape
        heads = self.qkv(self.norms[0](x)).view(batch, tokens, 3, self.heads, width // self.heads)
        query, key, value = heads.permute(2, 0, 3, 1, 4).unbind()
        mixed = functional.scaled_dot_product_attention(query, key, value)
        x = x + self.out(mixed.transpose(1, 2).reshape(batch, tokens, width))
        return x + self.narrow(functional.gelu(self.wide(self.norms[1](x))))


class VisionTransformer(nn.Module):
    """Patches of 8 x 8 of images of 64 x 64 and a class token, through six blocks, to ten classes."""

    def __init__(self, width=192):
        super().__init__()
        self.patches = nn.Conv2d(3, width, 8, 8)
        self.token = nn.Parameter(torch.zeros(1, 1, width))
        self.places = nn.Parameter(0.02 * torch.randn(1, 65, width))
        self.blocks = nn.Sequential(*(Block(width, 3) for _ in range(6)))
        self.norm, self.head = nn.LayerNorm(width, eps=1e-6), nn.Linear(width, 10)

    def forward(self, images):
        patches = self.patches(images).flatten(2).transpose(1, 2)
        tokens = torch.cat([self.token.expand(len(images), -1, -1), patches], 1) + self.places
        return self.head(self.norm(self.blocks(tokens))[:, 0])


def forward(function, *shapes):
    inputs = [torch.randn(shape) for shape in shapes]

    def work():
        with torch.no_grad():
            function(*inputs)

    return work


def both(function, *inputs):
    """Forward, and backward from fixed gradients of the result."""
    inputs = [x if isinstance(x, torch.Tensor) else torch.randn(x).requires_grad_() for x in inputs]
    cotangent = torch.randn(function(*inputs).shape)

    def work():
        for x in inputs:
            x.grad = None
        function(*inputs).backward(cotangent)

    return work


def of_block():
    block = Block(384, 6)
    x = torch.randn(2, 1024, 384).requires_grad_()
    cotangent = torch.randn(x.shape)

    def work():
        block.zero_grad()
        x.grad = None
        block(x).backward(cotangent)

    return work


def training():
    model = VisionTransformer()
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, weight_decay=0.01)
    images, classes = torch.randn(16, 3, 64, 64), torch.arange(16) % 10

    def work():
        optimizer.zero_grad()
        functional.cross_entropy(model(images), classes).backward()
        optimizer.step()

    return work


def rows():
    attention, tokens = (4, 6, 512, 64), (4096, 384)
    mix = functional.scaled_dot_product_attention
    for n in (512, 1024, 2048):
        yield f"matmul/{n}", forward(torch.matmul, (n, n), (n, n))
    yield "matmul/1374x1024x4096", forward(functional.linear, (1374, 1024), (4096, 1024))
    yield "matmul/2048x384x1536", forward(functional.linear, (2048, 384), (1536, 384))
    yield "bmm/24x512x64x512", forward(torch.bmm, (24, 512, 64), (24, 64, 512))
    yield "attention/forward", forward(mix, attention, attention, attention)
    yield "attention/forward_backward", both(mix, attention, attention, attention)
    yield "block/forward_backward", of_block()
    yield "vit/step", training()
    convolution = lambda x, w, b: functional.conv2d(x, w, b, padding=1)
    yield "conv3x3/forward_backward", both(convolution, (4, 64, 128, 128), (64, 64, 3, 3), (64,))
    bilinear = lambda x: functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
    yield "bilinear/forward_backward", both(bilinear, (1, 64, 128, 128))
    norm = lambda x, w, b: functional.layer_norm(x, (384,), w, b, 1e-6)
    yield "layer_norm/forward_backward", both(norm, tokens, (384,), (384,))
    yield "gelu/forward_backward", both(functional.gelu, tokens)
    yield "softmax/forward_backward", both(lambda x: x.softmax(-1), tokens)


def seconds(work, times):
    start = time.perf_counter()
    for _ in range(times):
        work()
    return time.perf_counter() - start


def milliseconds(work, runs):
    seconds(work, 2)
    times = 1 + int(LEAST_SECONDS / max(seconds(work, 1), 1e-6))
    return 1e3 * statistics.median(seconds(work, times) / times for _ in range(runs))


def main():
    threads, runs = map(int, sys.argv[1:])
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    print(json.dumps({name: milliseconds(work, runs) for name, work in rows()}))


if __name__ == "__main__":
    main()
