"""Reads a .wgi file by the layout in docs/reference/wgi.md, and prints its Gaussians, one a line."""
import math
import sys

data = open(sys.argv[1], "rb").read()
at = 0


def take(count):
    global at
    at += count
    return data[at - count : at]


def varint():
    number = shift = 0
    while True:
        byte = take(1)[0]
        number |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return number


class Decoder:
    def __init__(self, data):
        self.data, self.next, self.range, self.code = data, 0, 2**32 - 1, 0
        for _ in range(4):
            self.pull()

    def pull(self):
        byte = self.data[self.next] if self.next < len(self.data) else 0
        self.next += 1
        self.code = (self.code << 8 | byte) & 0xFFFFFFFF

    def symbol(self, firsts):
        """firsts: first part of each symbol, and 2^16."""
        part = self.range >> 16
        wanted = min(self.code // part, 65535)
        k = max(k for k in range(len(firsts) - 1) if firsts[k] <= wanted)
        self.code -= part * firsts[k]
        whole = firsts[k + 1] == 65536
        self.range = self.range - part * firsts[k] if whole else part * (firsts[k + 1] - firsts[k])
        while self.range < 2**24:
            self.range = self.range << 8
            self.pull()
        return k

    def raw(self, bits):
        high = self.raw(bits - 16) if bits > 16 else 0
        bits = min(bits, 16)
        part = self.range >> 16
        size = 2 ** (16 - bits)
        k = min(self.code // part, 65535) // size
        last = (k + 1) * size == 65536
        self.code -= part * k * size
        self.range = self.range - part * k * size if last else part * size
        while self.range < 2**24:
            self.range = self.range << 8
            self.pull()
        return high << bits | k


class Adaptive:
    def __init__(self, symbols):
        self.counts = [1] * symbols

    def read(self, decoder):
        total, spare = sum(self.counts), 65536 - len(self.counts)
        before = [sum(self.counts[:k]) for k in range(len(self.counts) + 1)]
        k = decoder.symbol([k + b * spare // total for k, b in enumerate(before)])
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


assert take(4) == b"WVSZ" and take(2) == bytes([1, 0])
count, streams = varint(), varint()
table = [(take(4), varint(), varint(), take(4)) for _ in range(streams)]
take(4)
head, *blocks = [take(length) for _, _, length, _ in table]
assert [name for name, *_ in table] == [b"pict"] + [b"gaus"] * len(blocks)
assert count == sum(symbols for _, symbols, *_ in table[1:])
assert len(head) == 10 + (16 * len(blocks) if len(blocks) > 1 else 0)
size = [int.from_bytes(head[0:4], "little"), int.from_bytes(head[4:8], "little")]
weights = [[0, 7, 14, 20][head[9] >> shift & 3] for shift in (0, 2, 4)]
margin = math.ceil(max(size) / 4)


def read_block(decoder):
    counts, colors = Number(32), [Number(32) for _ in range(3)]
    for c in range(8):
        step = 0.35 * 2 ** (c / 2)
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
            color = []
            for channel in range(3):
                s, m = sum(color[channel] for color in last[-3:]), len(last[-3:]) or 1
                expected = (2 * weights[channel] * s + 20 * m) // (40 * m)
                color.append(expected + colors[channel].signed(decoder))
            last.append(color)
            luma = 0.035 * 2 ** ((1 - c) / 2)
            y, co, cg = color[0] * luma, color[1] * 2 * luma, color[2] * 2 * luma
            print(*center, small * ratio, small, angle, y + co - cg, y + cg, y - co - cg)


for block in blocks:
    read_block(Decoder(block))
