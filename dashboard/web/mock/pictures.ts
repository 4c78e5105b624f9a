// SPDX-License-Identifier: Apache-2.0
import { Random } from './random';

// Sky, hills, ground and trees of each season.
const SEASONS: Record<string, [string, string, string, string]> = {
  summer: ['#a8c8e0', '#5c7a6e', '#6e8e48', '#305c34'],
  fall: ['#b4bcc8', '#787068', '#967a46', '#ac6028'],
  winter: ['#c0cad4', '#bec8d2', '#e4eaf0', '#606e74'],
};

const svg = (width: number, height: number, body: string): string =>
  `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">${body}</svg>`;

/** Draws the view from a train at a place: the same hills and trees in each season, in its colours. */
export function view(season: string, frame: number): string {
  const [sky, hills, ground, tree] = SEASONS[season] ?? ['#000', '#222', '#333', '#111'];
  let ridge = '';
  for (let x = 0; x <= 256; x += 8) ridge += ` ${x},${(48 - 14 * Math.sin((x / 40 + frame / 9) * 0.7) - 6 * Math.sin((x / 40 + frame / 9) * 1.9)).toFixed(1)}`;
  // Trees stand at places of the route and come nearer with each frame.
  let trees = '';
  for (let number = Math.floor(frame / 3) + 14; 3 * number - frame + 1.5 > 0.5; --number) {
    const random = new Random(number * 7919 + 13);
    const near = 1 / (3 * number - frame + 1.5);
    const x = 128 + (random.next() < 0.5 ? -1 : 1) * (2.2 + 3 * random.next()) * 130 * near;
    const [base, tall] = [62 + 130 * near, (5 + 3 * random.next()) * 42 * near];
    trees += `<path d="M${x} ${base - tall}l${tall / 4} ${tall}h${-tall / 2}z"/>`;
  }
  return svg(256, 144, `<path fill="${sky}" d="M0 0h256v144H0z"/><polygon fill="${hills}" points="0,62${ridge} 256,62"/><path fill="${ground}" d="M0 62h256v82H0z"/><g fill="${tree}">${trees}</g><path stroke="#b0b2b6" fill="none" d="M82 144 128 62l46 82"/>`);
}

/** Draws the similarities of two traversals: a bright diagonal in noise. */
export function matrix(size: number): string {
  const random = new Random(77);
  let cells = '';
  for (let y = 0; y < size; ++y)
    for (let x = 0; x < size; ++x) {
      const grey = Math.min(255, Math.round(40 + 70 * random.next() + 165 * Math.exp(-((x - y + Math.sin(y / 5)) ** 2) / 2)));
      cells += `<path fill="rgb(${grey},${grey},${grey})" d="M${x} ${y}h1v1h-1z"/>`;
    }
  return svg(size, size, cells);
}
