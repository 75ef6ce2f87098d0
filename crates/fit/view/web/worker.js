// The worker: it unpacks the scene, sorts, and writes files, so that the page never waits.

import { floaters } from "./floaters.js";
import { pack, parse, toPly } from "./scene.js";
import { Sorter } from "./sort.js";
import { upright } from "./upright.js";

let table;
let sorter;

/** The bytes of base64 text. */
function decoded(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  return Uint8Array.from(binary, (letter) => letter.charCodeAt(0));
}

/** The bytes, unpacked if they are gzip. */
async function unpacked(bytes) {
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes;
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function load({ text, bytes, antialiased }) {
  table = parse(await unpacked(text === undefined ? new Uint8Array(bytes) : decoded(text)));
  table.antialiased ||= antialiased;
  const { n, degree, splats, harmonics, means } = pack(table);
  sorter = new Sorter(means.slice());
  return [{ n, degree, splats, harmonics, means }, [splats.buffer, harmonics.buffer, means.buffer]];
}

const ACTIONS = {
  load,
  order(request) {
    const start = performance.now();
    const { order, range } = sorter.order(request);
    return [{ order, range, milliseconds: performance.now() - start }, [order.buffer]];
  },
  floaters() {
    const scores = floaters(table, sorter.means);
    return [scores, [scores.opacity.buffer, scores.size.buffer, scores.room.buffer]];
  },
  ply: ({ dropped, up }) => [{ blob: toPly(up ? upright(table, up) : table, dropped) }, []],
};

onmessage = async ({ data: { id, action, request } }) => {
  try {
    const [result, transferred] = await ACTIONS[action](request);
    postMessage({ id, result }, transferred);
  } catch (error) {
    postMessage({ id, error: error.message });
  }
};
