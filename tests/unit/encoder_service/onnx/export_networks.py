#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""export_networks.py FOLDER: writes networks that place recognition uses (random weights) as PyTorch exports them, and
what PyTorch computes for one picture: NAME.onnx, with weights beside it or inside, and NAME.f32.

Needs the packages torch and onnxscript. OnnxNets.NetworksOfToday (CITYLEARN_NETWORKS=FOLDER) runs them.
"""
import pathlib
import sys

import torch
from torch import nn
from torch.nn import functional


def convolution(inputs, outputs, side, stride=1):
    return nn.Sequential(nn.Conv2d(inputs, outputs, side, stride, side // 2, bias=False), nn.BatchNorm2d(outputs))


class Bottleneck(nn.Module):
    def __init__(self, inputs, width, stride):
        super().__init__()
        self.body = nn.Sequential(convolution(inputs, width, 1), nn.ReLU(), convolution(width, width, 3, stride),
                                  nn.ReLU(), convolution(width, 4 * width, 1))
        self.skip = nn.Identity() if inputs == 4 * width else convolution(inputs, 4 * width, 1, stride)

    def forward(self, x):
        return functional.relu(self.body(x) + self.skip(x))


def resnet50(stages):
    blocks, inputs = [convolution(3, 64, 7, 2), nn.ReLU(), nn.MaxPool2d(3, 2, 1)], 64
    for stage, count in enumerate((3, 4, 6, 3)[:stages]):
        for i in range(count):
            blocks.append(Bottleneck(inputs, 64 << stage, 2 if stage > 0 and i == 0 else 1))
            inputs = 256 << stage
    return nn.Sequential(*blocks)


class ResnetGem(nn.Module):
    """ResNet-50 and generalised mean pooling, as CosPlace and EigenPlaces."""

    def __init__(self):
        super().__init__()
        self.body, self.linear, self.power = resnet50(4), nn.Linear(2048, 512), nn.Parameter(torch.tensor(3.0))

    def forward(self, x):
        maps = functional.normalize(self.body(x))
        pooled = functional.avg_pool2d(maps.clamp(min=1e-6).pow(self.power), maps.shape[-2:]).pow(1 / self.power)
        return functional.normalize(self.linear(pooled.flatten(1)))


class VggNetvlad(nn.Module):
    """VGG-16 up to conv5_3 and NetVLAD (Arandjelovic et al., CVPR 2016)."""

    def __init__(self):
        super().__init__()
        layers, inputs = [], 3
        for width in (64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512):
            layers += [nn.Conv2d(inputs, width, 3, 1, 1), nn.ReLU()] if width else [nn.MaxPool2d(2)]
            inputs = width or inputs
        self.body, self.assign = nn.Sequential(*layers[:-1]), nn.Conv2d(512, 64, 1)
        self.centres = nn.Parameter(torch.randn(64, 512) / 23)

    def forward(self, x):
        maps = functional.normalize(self.body(x))
        shares = self.assign(maps).flatten(2).softmax(1)
        vlad = shares @ maps.flatten(2).transpose(1, 2) - shares.sum(2, keepdim=True) * self.centres
        return functional.normalize(functional.normalize(vlad, dim=2).flatten(1))


class Block(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.heads, self.first, self.second = heads, nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mlp = nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))
        self.scale = nn.Parameter(torch.full((2, width), 0.5))

    def forward(self, x):
        batch, tokens, width = x.shape
        q, k, v = self.qkv(self.first(x)).reshape(batch, tokens, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        seen = functional.scaled_dot_product_attention(q, k, v).transpose(1, 2).reshape(batch, tokens, width)
        x = x + self.scale[0] * self.out(seen)
        return x + self.scale[1] * self.mlp(self.second(x))


class Mixvpr(nn.Module):
    """ResNet-50 up to its third stage and MixVPR (Ali-bey et al., WACV 2023): perceptrons across places, then projections."""

    def __init__(self, places=196):
        super().__init__()
        mixer = lambda: nn.Sequential(nn.LayerNorm(places), nn.Linear(places, places), nn.ReLU(), nn.Linear(places, places))
        self.body, self.mixers = resnet50(3), nn.ModuleList(mixer() for _ in range(4))
        self.channels, self.rows = nn.Linear(1024, 512), nn.Linear(places, 4)

    def forward(self, x):
        maps = self.body(x).flatten(2)
        for mixer in self.mixers:
            maps = maps + mixer(maps)
        mixed = self.rows(self.channels(maps.transpose(1, 2)).transpose(1, 2))
        return functional.normalize(mixed.flatten(1))


class Boq(nn.Module):
    """ResNet-50 up to its third stage and a bag of learned queries (Ali-bey et al., CVPR 2024)."""

    def __init__(self, width=256, queries=32):
        super().__init__()
        attention = lambda: nn.MultiheadAttention(width, 8, batch_first=True)
        self.body, self.project, self.norm = resnet50(3), nn.Conv2d(1024, width, 3, 1, 1), nn.LayerNorm(width)
        self.encoders = nn.ModuleList(nn.TransformerEncoderLayer(width, 8, 4 * width, 0, batch_first=True) for _ in range(2))
        self.queries = nn.ParameterList(torch.randn(1, queries, width) for _ in range(2))
        self.among, self.across = nn.ModuleList(attention() for _ in range(2)), nn.ModuleList(attention() for _ in range(2))
        self.linear = nn.Linear(2 * queries, 16)

    def forward(self, x):
        tokens, found = self.norm(self.project(self.body(x)).flatten(2).transpose(1, 2)), []
        for encoder, query, among, across in zip(self.encoders, self.queries, self.among, self.across):
            tokens, query = encoder(tokens), query.expand(x.shape[0], -1, -1)
            query = query + among(query, query, query)[0]
            found.append(across(query, tokens, tokens)[0])
        return functional.normalize(self.linear(torch.cat(found, 1).transpose(1, 2)).flatten(1))


class Vit(nn.Module):
    """A ViT-S/14 as DINOv2's: the class token after the last norm."""

    def __init__(self, width=384, depth=12):
        super().__init__()
        self.patches, self.token = nn.Conv2d(3, width, 14, 14), nn.Parameter(torch.randn(1, 1, width))
        self.places, self.norm = nn.Parameter(torch.randn(1, 257, width) / 50), nn.LayerNorm(width)
        self.blocks = nn.Sequential(*[Block(width, 6) for _ in range(depth)])

    def tokens(self, x):
        tokens = self.patches(x).flatten(2).transpose(1, 2)
        return self.norm(self.blocks(torch.cat([self.token.expand(x.shape[0], -1, -1), tokens], 1) + self.places))

    def forward(self, x):
        return self.tokens(x)[:, 0]


class Salad(nn.Module):
    """A ViT-S/14 and SALAD (Izquierdo and Civera, CVPR 2024): optimal transport of tokens to clusters and a dustbin."""

    def __init__(self):
        super().__init__()
        perceptron = lambda inputs, outputs: nn.Sequential(nn.Linear(inputs, 512), nn.ReLU(), nn.Linear(512, outputs))
        self.body, self.dust = Vit(), nn.Parameter(torch.tensor(1.0))
        self.token, self.values, self.scores = perceptron(384, 256), perceptron(384, 128), perceptron(384, 64)

    def forward(self, x):
        tokens = self.body.tokens(x)
        patches = tokens[:, 1:]
        scores = self.scores(patches).transpose(1, 2)
        plan = torch.cat([scores, self.dust.expand(scores.shape[0], 1, scores.shape[2])], 1)
        count = scores.shape[2]
        shares = torch.cat([torch.zeros(64), torch.tensor([count - 64.0]).log()])[None, :, None]
        for _ in range(3):  # Sinkhorn's steps, in logarithms
            plan = plan - plan.logsumexp(2, keepdim=True) + shares
            plan = plan - plan.logsumexp(1, keepdim=True)
        clusters = functional.normalize(plan.exp()[:, :-1] @ self.values(patches), dim=2)
        return functional.normalize(torch.cat([functional.normalize(self.token(tokens[:, 0])), clusters.flatten(1)], 1))


def main():
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    y, x, c = torch.meshgrid(torch.arange(224), torch.arange(224), torch.arange(3), indexing="ij")
    pixels = (31 * y + 17 * x + 101 * c + x * y) % 256  # the test makes the same picture
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    picture = ((pixels.double() / 255 - mean.double()) / deviation.double()).float().permute(2, 0, 1)[None]
    ways = {"default": {}, "open": {"dynamic_shapes": ({0: torch.export.Dim("batch", max=64)},)}, "older": {"dynamo": False}}
    for network in (ResnetGem, VggNetvlad, Vit, Mixvpr, Salad, Boq):
        model = network().eval()
        for way, options in ways.items():
            name = f"{network.__name__}-{way}"
            # An open batch is exported with two pictures: one would be taken for a fixed number.
            example = picture.repeat(2 if way == "open" else 1, 1, 1, 1)
            torch.onnx.export(model, (example,), str(folder / f"{name}.onnx"), **options)
            with torch.no_grad():
                (folder / f"{name}.f32").write_bytes(model(picture).numpy().tobytes())
            print(name, flush=True)


main()
