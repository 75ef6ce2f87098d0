"""Reads a .wgi file by the layout in docs/reference/wgi.md, and prints its Gaussians, one a line."""
import io
import math
import sys

file = io.BytesIO(open(sys.argv[1], "rb").read())


def varint():
    byte = file.read(1)[0]
    return byte if byte < 128 else byte & 127 | varint() << 7


class Decoder:
    def __init__(self, data):
        self.data, self.range = io.BytesIO(data + bytes(4)), 2**32 - 1
        self.code = int.from_bytes(self.data.read(4), "big")

    def wanted(self):
        return min(self.code // (self.range >> 16), 65535)

    def take(self, first, end):
        part = self.range >> 16
        self.code -= part * first
        self.range = self.range - part * first if end == 65536 else part * (end - first)
        while self.range < 2**24:
            self.range, self.code = self.range << 8, self.code << 8 | (self.data.read(1) or b"\0")[0]

    def raw(self, bits):
        high = self.raw(bits - 16) if bits > 16 else 0
        bits = min(bits, 16)
        size = 2 ** (16 - bits)
        k = self.wanted() // size
        self.take(k * size, (k + 1) * size)
        return high << bits | k


class Adaptive:
    def __init__(self, symbols):
        self.counts = [1] * symbols

    def read(self, decoder):
        total, spare = sum(self.counts), 65536 - len(self.counts)
        firsts = [k + sum(self.counts[:k]) * spare // total for k in range(len(self.counts) + 1)]
        k = max(k for k, first in enumerate(firsts[:-1]) if first <= decoder.wanted())
        decoder.take(firsts[k], firsts[k + 1])
        self.counts[k] += 2
        return k


class Number:
    def __init__(self, longest):
        self.length, self.sign = Adaptive(longest + 1), Adaptive(2)
        self.top = [Adaptive(4) for _ in range(longest + 1)]

    def read(self, decoder):
        length = self.length.read(decoder)
        if length < 2:
            return length
        modeled = min(2, length - 1)
        number, rest = 1 << modeled | self.top[length].read(decoder), length - 1 - modeled
        while rest > 0:
            bits = min(rest, 32)
            number, rest = number << bits | decoder.raw(bits), rest - bits
        return number

    def signed(self, decoder):
        number = self.read(decoder)
        return -number if number and self.sign.read(decoder) else number


assert file.read(6) == b"WVSZ\1\0"
count, streams = varint(), varint()
table = [(file.read(4), varint(), varint(), file.read(4)) for _ in range(streams)]
file.read(4)
head, *blocks = [file.read(length) for _, _, length, _ in table]
assert [name for name, *_ in table] == [b"pict"] + [b"gaus"] * len(blocks)
assert count == sum(symbols for _, symbols, *_ in table[1:])
size = [int.from_bytes(head[at : at + 4], "little") for at in (0, 4)]
weights = [[0, 7, 14, 20][head[9] >> shift & 3] for shift in (0, 2, 4)]
margin = math.ceil(max(size) / 4)
for decoder in map(Decoder, blocks):
    counts, colors = Number(32), [Number(32) for _ in range(3)]
    for c in range(8):
        step, luma = 0.35 * 2 ** (c / 2), 0.035 * 2 ** ((1 - c) / 2)
        largest = max(math.floor((side + 2 * margin) / step) for side in size)
        positions, scales, ratios = Number(2 * largest.bit_length()), Number(8), Number(8)
        morton, last = 0, []
        for _ in range(counts.read(decoder)):
            morton += positions.read(decoder)
            center = [sum((morton >> 2 * i + axis & 1) << i for i in range(32)) * step - margin for axis in (0, 1)]
            small = 0.5 * 2 ** (0.35 * scales.signed(decoder))
            ratio = 2 ** (0.35 * ratios.read(decoder))
            bits = round(math.log2(4 + 10 * (ratio - 1 / ratio))) if ratio > 1 else 0
            angle = math.pi * (decoder.raw(bits) if bits else 0) / 2**bits
            last = last[-3:]
            sums, m = [sum(channel) for channel in zip(*last)] or [0] * 3, len(last) or 1
            expected = [(2 * weight * s + 20 * m) // (40 * m) for weight, s in zip(weights, sums)]
            last.append([number + model.signed(decoder) for number, model in zip(expected, colors)])
            y, co, cg = last[-1][0] * luma, last[-1][1] * 2 * luma, last[-1][2] * 2 * luma
            print(*center, small * ratio, small, angle, y + co - cg, y + cg, y - co - cg)
