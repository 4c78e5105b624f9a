// SPDX-License-Identifier: Apache-2.0
import { png } from './png';
import { Random } from './random';

type Colour = readonly [number, number, number];
interface Season {
  sky: Colour;
  low: Colour;
  hill: Colour;
  ground: Colour;
  tree: Colour;
}

const SEASONS: Record<string, Season> = {
  summer: { sky: [120, 172, 220], low: [222, 234, 240], hill: [92, 122, 110], ground: [110, 142, 72], tree: [48, 92, 52] },
  fall: { sky: [150, 164, 184], low: [232, 222, 206], hill: [120, 112, 104], ground: [150, 122, 70], tree: [172, 96, 40] },
  winter: { sky: [170, 184, 200], low: [236, 240, 244], hill: [190, 200, 210], ground: [228, 234, 240], tree: [96, 110, 116] },
};

const WIDTH = 256;
const HEIGHT = 144;

/** A drawn view from a train at a place: the same hills and trees in each season, in its colours. */
export function view(season: string, frame: number): Buffer {
  const s = SEASONS[season] ?? (SEASONS.summer as Season);
  const pixels = new Uint8Array(WIDTH * HEIGHT * 3);
  const horizon = 62;
  const put = (x: number, y: number, c: Colour): void => {
    if (x < 0 || y < 0 || x >= WIDTH || y >= HEIGHT) return;
    pixels.set(c, (y * WIDTH + x) * 3);
  };
  const mix = (a: Colour, b: Colour, t: number): Colour => [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t];
  for (let x = 0; x < WIDTH; ++x) {
    const far = x / 40 + frame / 9;
    const hill = horizon - 12 - 14 * Math.sin(far * 0.7) - 8 * Math.sin(far * 1.9 + 1) - 3 * Math.sin(far * 5.3);
    for (let y = 0; y < HEIGHT; ++y) {
      if (y < hill) put(x, y, mix(s.sky, s.low, y / horizon));
      else if (y < horizon) put(x, y, mix(s.hill, s.low, 0.25));
      else put(x, y, mix(s.ground, s.hill, 0.5 * (1 - (y - horizon) / (HEIGHT - horizon))));
    }
  }
  // Trees stand at places of the route and come nearer with each frame.
  const first = Math.floor(frame / 3);
  for (let tree = first + 14; tree >= first; --tree) {
    const random = new Random(tree * 7919 + 13);
    const distance = tree * 3 - frame + 1.5;
    if (distance <= 0.5) continue;
    const side = random.next() < 0.5 ? -1 : 1;
    const across = side * (2.2 + 3 * random.next());
    const x = Math.round(WIDTH / 2 + (across * 130) / distance);
    const base = Math.round(horizon + 130 / distance);
    const tall = ((5 + 3 * random.next()) * 42) / distance;
    for (let y = 0; y < tall; ++y) {
      const half = Math.max(1, (tall * 0.26 * y) / tall);
      for (let dx = -half; dx <= half; ++dx) put(Math.round(x + dx), Math.round(base - tall + y), mix(s.tree, s.ground, dx > 0 ? 0.15 : 0));
    }
  }
  // Rails.
  for (let y = horizon + 1; y < HEIGHT; ++y) {
    const depth = (y - horizon) / (HEIGHT - horizon);
    const sleeper = Math.floor(6 / depth + frame * 1.5) % 2 === 0;
    const half = 46 * depth;
    for (let dx = -half * 1.35; dx <= half * 1.35; ++dx) if (sleeper) put(Math.round(WIDTH / 2 + dx), y, [88, 76, 66]);
    for (const edge of [-half, half])
      for (let w = 0; w <= 2 * depth + 0.5; ++w) put(Math.round(WIDTH / 2 + edge + w), y, [176, 178, 182]);
  }
  return png(WIDTH, HEIGHT, pixels);
}

/** Similarities of two traversals: a bright diagonal in noise. */
export function matrix(size: number): Buffer {
  const random = new Random(77);
  const pixels = new Uint8Array(size * size * 3);
  for (let y = 0; y < size; ++y)
    for (let x = 0; x < size; ++x) {
      const near = Math.exp(-((x - y + 3 * Math.sin(y / 16)) ** 2) / 6);
      const value = Math.min(255, 40 + 70 * random.next() + 30 * Math.sin(x / 17) * Math.sin(y / 13) + 165 * near);
      pixels.set([value, value, value], (y * size + x) * 3);
    }
  return png(size, size, pixels);
}
