// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import type { TraversalMap } from '../api/types';
import { integer, metres } from '../maths/format';
import { fit, nearest, project, scaleBar, ticks, toScreen, zoomAt, type Point, type View } from '../maths/geometry';
import { colour, shown } from '../state/theme';
import { IconButton } from './basics';
import { useSize } from './use';

/** An agent on the route. Frames are indices on the traversal. */
export interface Walker {
  label: string;
  position: number;
  start: number;
  goal: number;
  idle?: boolean;
}

interface RouteMapProps {
  map: TraversalMap | null;
  /** The part of the traversal that the agents are on. */
  first: number;
  count: number;
  walkers: readonly Walker[];
  selected: number;
  /** Positions of the selected agent since its start. */
  path: readonly number[];
  onSelect?: (walker: number) => void;
  whole: boolean;
  label: string;
  height?: number;
}

const SERIES = 8;
const FONT = '"Inter Variable", system-ui, sans-serif';

export function walkerColour(walker: number): string {
  return `series-${(walker % SERIES) + 1}`;
}

/** Returns a point of the plane for each frame: where it was recorded, or on a straight ruler with one unit per frame. */
function placesOf(map: TraversalMap | null, frames: number): { points: (Point | null)[]; gps: boolean } {
  const places = map?.latitude && map.longitude ? project(map.latitude, map.longitude) : null;
  if (places) return { points: places, gps: true };
  return { points: Array.from({ length: frames }, (_, i) => ({ x: i, y: 0 })), gps: false };
}

/** Draws the route with its agents: a map, north up, where positions are known; else a ruler with a lane per agent. */
export function RouteMap(props: RouteMapProps): JSX.Element {
  const { map, first, count, walkers, whole, label } = props;
  const [room, size] = useSize<HTMLDivElement>();
  const canvas = useRef<HTMLCanvasElement>(null);
  const frames = Math.max(map?.frames ?? 0, first + count);
  const { points, gps } = useMemo(() => placesOf(map, frames), [map, frames]);
  // A ruler needs one lane per agent.
  const height = props.height ?? (gps ? (size.width > 1100 ? 640 : 440) : Math.min(560, 90 + 22 * walkers.length));
  const [view, setView] = useState<View | null>(null); // null: everything fits
  const from = whole ? 0 : first;
  const to = whole ? frames : first + count;
  useEffect(() => setView(null), [points, from, to, size.width]);
  const fitted = useMemo(
    () => fit(points.slice(from, to), size.width, height, gps ? 36 : 60),
    [points, from, to, size.width, height, gps],
  );
  const current = view ?? fitted;
  const drag = useRef<Point | null>(null);

  useEffect(() => {
    const element = canvas.current;
    if (!element || size.width < 10) return undefined;
    const request = requestAnimationFrame(() => draw(element, { ...props, height, points, gps, frames, view: current, width: size.width }));
    return () => cancelAnimationFrame(request);
  });
  void shown.value; // the theme determines the colours

  const zoom = (factor: number, about: Point = { x: size.width / 2, y: height / 2 }): void => setView(zoomAt(current, about, factor));
  const pan = (x: number, y: number): void => setView({ ...current, x: current.x + x, y: current.y + (gps ? y : 0) });
  const keys: Record<string, () => void> = {
    '+': () => zoom(1.4),
    '=': () => zoom(1.4),
    '-': () => zoom(1 / 1.4),
    '0': () => setView(null),
    ArrowLeft: () => pan(40, 0),
    ArrowRight: () => pan(-40, 0),
    ArrowUp: () => pan(0, 40),
    ArrowDown: () => pan(0, -40),
  };
  const pick = (at: Point): void => {
    const places = walkers.map((walker, i) => placeOf(walker, i, { points, gps, view: current, height, walkers }));
    const found = nearest(places, at, 22);
    if (found >= 0) props.onSelect?.(found);
  };
  return (
    <div class="map-room" ref={room}>
      <canvas
        ref={canvas}
        class="map"
        role="img"
        tabIndex={0}
        aria-label={`${label}. ${gps ? 'Map, north up' : 'Straight ruler of frames'}; plus and minus zoom, arrows move, 0 shows all.`}
        style={{ height: `${height}px` }}
        onKeyDown={(event) => {
          const act = keys[event.key];
          if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
          event.preventDefault();
          act();
        }}
        onWheel={(event) => {
          if (!event.ctrlKey && document.activeElement !== canvas.current) return; // the page scrolls
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 400), { x: event.offsetX, y: event.offsetY });
        }}
        onPointerDown={(event) => {
          drag.current = { x: event.offsetX, y: event.offsetY };
          pick(drag.current);
        }}
        onPointerMove={(event) => {
          if (!drag.current || event.buttons === 0) return;
          pan(event.offsetX - drag.current.x, event.offsetY - drag.current.y);
          drag.current = { x: event.offsetX, y: event.offsetY };
        }}
        onPointerUp={() => (drag.current = null)}
        onPointerLeave={() => (drag.current = null)}
      />
      <div class="map-buttons">
        <IconButton icon="plus" label="Zoom in" onClick={() => zoom(1.4)} />
        <IconButton icon="minus" label="Zoom out" onClick={() => zoom(1 / 1.4)} />
        <IconButton icon="home" label="Show all of it" disabled={view === null} onClick={() => setView(null)} />
      </div>
    </div>
  );
}

interface Layout {
  points: readonly (Point | null)[];
  gps: boolean;
  view: View;
  height: number;
  walkers: readonly Walker[];
}

const RULER = 46; // pixels at the bottom

function laneOf(index: number, { height, walkers }: Layout): number {
  const top = 18;
  return top + ((height - RULER - top) * (index + 0.5)) / Math.max(walkers.length, 1);
}

/** Returns where a frame is on the screen; on a ruler, in the lane of the given agent. */
function frameAt(frame: number, lane: number, layout: Layout): Point | null {
  const point = layout.points[frame];
  if (!point) return null;
  const at = toScreen(layout.view, point);
  return layout.gps ? at : { x: at.x, y: laneOf(lane, layout) };
}

function placeOf(walker: Walker, index: number, layout: Layout): Point | null {
  return frameAt(walker.position, index, layout);
}

interface Drawing extends Omit<RouteMapProps, 'height'>, Layout {
  width: number;
  frames: number;
}

function draw(canvas: HTMLCanvasElement, d: Drawing): void {
  const ratio = devicePixelRatio;
  canvas.width = Math.round(d.width * ratio);
  canvas.height = Math.round(d.height * ratio);
  const ctx = canvas.getContext('2d');
  if (!ctx) return;
  ctx.scale(ratio, ratio);
  ctx.lineJoin = ctx.lineCap = 'round';
  if (d.gps) drawTrack(ctx, d);
  else drawRuler(ctx, d);
  d.walkers.forEach((walker, i) => {
    if (i !== d.selected) drawWalker(ctx, d, walker, i);
  });
  const chosen = d.walkers[d.selected];
  if (chosen) drawWalker(ctx, d, chosen, d.selected);
}

function line(ctx: CanvasRenderingContext2D, points: readonly (Point | null)[], stroke: string, width: number): void {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width;
  ctx.beginPath();
  let down = false;
  for (const point of points) {
    if (point && down) ctx.lineTo(point.x, point.y);
    else if (point) ctx.moveTo(point.x, point.y);
    down = point !== null;
  }
  ctx.stroke();
}

function text(ctx: CanvasRenderingContext2D, what: string, x: number, y: number, align: CanvasTextAlign, weight = 400): void {
  ctx.font = `${weight} 12px ${FONT}`;
  ctx.textAlign = align;
  ctx.fillText(what, x, y);
}

function drawTrack(ctx: CanvasRenderingContext2D, d: Drawing): void {
  const screen = d.points.map((point) => (point ? toScreen(d.view, point) : null));
  line(ctx, screen, colour('map-rest'), 3);
  line(ctx, screen.slice(d.first, d.first + d.count), colour('map-route'), 5);
  if (d.path.length > 1) {
    const least = d.path.reduce((a, b) => Math.min(a, b));
    const most = d.path.reduce((a, b) => Math.max(a, b));
    line(ctx, screen.slice(least, most + 1), colour(walkerColour(d.selected)), 5);
  }
  // Scale and north.
  const soft = colour('text-soft');
  const bar = scaleBar(d.view, Math.min(160, d.width / 3));
  const y = d.height - 16;
  ctx.strokeStyle = ctx.fillStyle = soft;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(16, y - 5);
  ctx.lineTo(16, y);
  ctx.lineTo(16 + bar.pixels, y);
  ctx.lineTo(16 + bar.pixels, y - 5);
  ctx.stroke();
  text(ctx, metres(bar.length), 16 + bar.pixels / 2, y - 8, 'center');
  ctx.beginPath();
  ctx.moveTo(22, 34);
  ctx.lineTo(22, 14);
  ctx.moveTo(17, 20);
  ctx.lineTo(22, 14);
  ctx.lineTo(27, 20);
  ctx.stroke();
  text(ctx, 'N', 22, 48, 'center', 600);
}

function drawRuler(ctx: CanvasRenderingContext2D, d: Drawing): void {
  const soft = colour('text-soft');
  const base = d.height - RULER + 8;
  const at = (frame: number): number => frame * d.view.scale + d.view.x;
  const from = Math.max(0, Math.ceil(-d.view.x / d.view.scale));
  const to = Math.min(d.frames - 1, Math.floor((d.width - d.view.x) / d.view.scale));
  line(ctx, [{ x: at(0), y: base }, { x: at(d.frames - 1), y: base }], colour('map-rest'), 3);
  line(ctx, [{ x: at(d.first), y: base }, { x: at(d.first + d.count - 1), y: base }], colour('map-route'), 5);
  d.walkers.forEach((_, i) => {
    const y = laneOf(i, d);
    line(ctx, [{ x: at(d.first), y }, { x: at(d.first + d.count - 1), y }], colour(i === d.selected ? 'line' : 'line-soft'), i === d.selected ? 2 : 1);
  });
  ctx.fillStyle = soft;
  for (const frame of ticks(from, to, d.width / 110)) {
    if (at(frame) < 20 || at(frame) > d.width - 24) continue; // its label would be cut
    line(ctx, [{ x: at(frame), y: base }, { x: at(frame), y: base + 7 }], soft, 1);
    text(ctx, integer(frame), at(frame), base + 20, 'center');
    const along = d.map?.position[frame] ?? null;
    const zero = d.map?.position[0] ?? null;
    if (along !== null && zero !== null) text(ctx, metres(along - zero), at(frame), base + 34, 'center');
  }
  text(ctx, 'frame', 6, base - 8, 'left');
  if (d.path.length > 1) {
    const y = laneOf(d.selected, d);
    const least = d.path.reduce((a, b) => Math.min(a, b));
    const most = d.path.reduce((a, b) => Math.max(a, b));
    line(ctx, [{ x: at(least), y }, { x: at(most), y }], colour(walkerColour(d.selected)), 4);
  }
}

function disc(ctx: CanvasRenderingContext2D, at: Point, radius: number): void {
  ctx.beginPath();
  ctx.arc(at.x, at.y, radius, 0, 2 * Math.PI);
}

function drawWalker(ctx: CanvasRenderingContext2D, d: Drawing, walker: Walker, index: number): void {
  if (walker.idle) return;
  const mine = index === d.selected;
  const stroke = colour(walkerColour(index));
  const surface = colour('surface');
  const start = frameAt(walker.start, index, d);
  const goal = frameAt(walker.goal, index, d);
  const here = placeOf(walker, index, d);
  ctx.lineWidth = 2;
  // A map shows only the selected agent's start and goal: others would hide the route.
  if (start && (mine || !d.gps)) {
    const half = mine ? 5 : 3;
    ctx.fillStyle = surface;
    ctx.strokeStyle = stroke;
    ctx.fillRect(start.x - half, start.y - half, 2 * half, 2 * half);
    ctx.strokeRect(start.x - half, start.y - half, 2 * half, 2 * half);
  }
  if (goal && (mine || !d.gps)) {
    ctx.strokeStyle = stroke;
    ctx.fillStyle = surface;
    disc(ctx, goal, mine ? 8 : 5);
    ctx.fill();
    ctx.stroke();
    ctx.fillStyle = stroke;
    disc(ctx, goal, mine ? 3 : 2);
    ctx.fill();
  }
  if (!here) return;
  disc(ctx, here, mine ? 8 : 5);
  ctx.fillStyle = stroke;
  ctx.strokeStyle = surface;
  ctx.fill();
  ctx.stroke();
  if (mine && d.gps) {
    ctx.fillStyle = colour('text');
    for (const [place, word] of [[start, 'start'], [goal, 'goal'], [here, walker.label]] as const)
      if (place) label(ctx, word, place, d.width, surface);
  }
}

function label(ctx: CanvasRenderingContext2D, word: string, at: Point, width: number, halo: string): void {
  ctx.font = `600 12px ${FONT}`;
  ctx.strokeStyle = halo;
  ctx.lineWidth = 4;
  const left = at.x + 12 + ctx.measureText(word).width < width; // else the label is on the other side
  ctx.textAlign = left ? 'left' : 'right';
  const x = left ? at.x + 12 : at.x - 12;
  ctx.strokeText(word, x, at.y - 8);
  ctx.fillText(word, x, at.y - 8);
}
