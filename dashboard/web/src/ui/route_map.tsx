// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import type { Belief, TraversalMap } from '../api/types';
import { integer, metres } from '../maths/format';
import { fit, greatest, least, nearest, originOf, pathOf, project, scaleBar, ticks, toScreen, zoomAt, type Point, type View } from '../maths/geometry';
import { detailOf, pointAt, pointsBetween, refined, valueAt } from '../maths/outline';
import { planeOfStreets, type StreetPlane } from '../maths/streets';
import { useJson, valueOf } from '../state/resource';
import { seriesColour } from '../state/theme';
import { IconButton, Swatch } from './basics';
import { StreetCanvas } from './street_canvas';
import { useSize } from './use';

/** An agent on the route. Frames are indices on the traversal; on streets the goal is a place. */
export interface Walker {
  label: string;
  position: number;
  start: number;
  goal: number;
  idle?: boolean;
}

interface RouteMapProps {
  /** The hash of the traversal; null: it has no map. */
  hash: string | null;
  /** The part of the traversal that the agents are on. */
  first: number;
  count: number;
  walkers: readonly Walker[];
  selected: number;
  /** Positions of the selected agent since its start. */
  path: readonly number[];
  /** Where the selected agent believes to stand. */
  heat?: Belief['places'] | undefined;
  onSelect?: (walker: number) => void;
  whole: boolean;
  label: string;
}

/** What is drawn, and where. */
interface Scene extends RouteMapProps {
  map: TraversalMap | null;
  frames: number;
  /** Where the map's frames were recorded, on a plane. Null: the frames are on a straight ruler with one unit per frame. */
  points: readonly (Point | null)[] | null;
  /** On a line: null. */
  plane: StreetPlane | null;
  view: View;
  width: number;
  height: number;
}

/** Draws the route with its agents: a map, north up, where positions are known; else a ruler with a lane per agent. */
export function RouteMap(props: RouteMapProps): JSX.Element {
  const { hash, first, count, walkers, selected, whole, label } = props;
  const coarse = valueOf(useJson<TraversalMap>(hash === null ? null : `api/map/${hash}`));
  const [part, setPart] = useState<string | null>(null); // in more detail
  const more = valueOf(useJson<TraversalMap>(coarse === null || part === null ? null : `api/map/${coarse.hash}${part}`));
  const detail = useRef(more); // the last one, until the next one is there
  detail.current = more ?? detail.current;
  const [room, { width }] = useSize<HTMLDivElement>();
  const plane = useMemo(() => (coarse?.streets ? planeOfStreets(coarse.streets) : null), [coarse]);
  const map = useMemo(
    () => coarse && (plane ? { ...coarse, index: plane.states.map((_, state) => state) } : refined(coarse, detail.current)),
    [coarse, plane, detail.current],
  );
  const frames = Math.max(map?.frames ?? 0, first + count);
  const origin = useMemo(() => (coarse?.latitude && coarse.longitude ? originOf(coarse.latitude, coarse.longitude) : null), [coarse]);
  const planeOf = (one: TraversalMap | null): (Point | null)[] | null => (one?.latitude && one.longitude ? project(one.latitude, one.longitude, origin) : null);
  const points = useMemo(() => plane?.states ?? planeOf(map), [plane, map]);
  const outline = useMemo(() => planeOf(coarse), [coarse]);
  const gps = points !== null;
  // A ruler needs one lane per agent.
  const height = gps ? (width > 1100 ? 640 : 440) : Math.min(560, 90 + 22 * walkers.length);
  const [view, setView] = useState<View | null>(null); // null: everything fits
  const from = whole ? 0 : first;
  const to = whole ? frames : first + count;
  useEffect(() => setView(null), [hash, origin, plane, from, to, width]);
  const fitted = useMemo(() => {
    // Frames are counted by services: nothing is made for each that they claim.
    const ends = [{ x: from, y: 0 }, { x: to - 1, y: 0 }];
    return map && points ? fit(pointsBetween(map.index, points, from, to - 1), width, height, 36) : fit(ends, width, height, 60);
  }, [origin, plane, from, to, width, height]);
  const current = view ?? fitted;
  const wanted = useMemo(() => (coarse && outline ? detailOf(coarse, outline, current, width, height) : null), [outline, current, width, height]);
  useEffect(() => {
    if (wanted !== null) setPart(wanted);
  }, [wanted]);
  const drag = useRef<Point | null>(null);
  const scene: Scene = { ...props, map, frames, points, plane, view: current, width, height };

  const zoom = (factor: number, about: Point = { x: width / 2, y: height / 2 }): void => setView(zoomAt(current, about, factor));
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
    const found = nearest(walkers.map((walker, i) => screenAt(scene, walker.position, i)), at, 22);
    if (found >= 0) props.onSelect?.(found);
  };
  return (
    <div class="map-room" ref={room}>
      {plane && <StreetCanvas plane={plane} view={current} width={width} height={height} />}
      <svg
        class={plane ? 'map over' : 'map'}
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
          if (!event.ctrlKey && document.activeElement !== event.currentTarget) return; // the page scrolls
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
      >
        {map && points ? <Track {...scene} map={map} points={points} /> : <Ruler {...scene} />}
        {props.heat?.map(({ frame, probability }) => {
          const at = probability >= 0.01 && screenAt(scene, frame, selected);
          return at && <circle key={frame} class="heat" cx={at.x} cy={at.y} r={8 + 12 * Math.sqrt(probability)} opacity={Math.sqrt(probability)} />;
        })}
        {walkers.map((walker, i) => i !== selected && <WalkerSigns key={i} scene={scene} walker={walker} index={i} />)}
        {walkers[selected] && <WalkerSigns scene={scene} walker={walkers[selected]} index={selected} />}
      </svg>
      <div class="framed map-buttons">
        <IconButton icon="plus" label="Zoom in" onClick={() => zoom(1.4)} />
        <IconButton icon="minus" label="Zoom out" onClick={() => zoom(1 / 1.4)} />
        <IconButton icon="home" label="Show all of it" disabled={view === null} onClick={() => setView(null)} />
      </div>
    </div>
  );
}

const RULER = 46; // pixels at the bottom
const LANES = 18; // pixels above the first lane

function laneOf(index: number, { height, walkers }: Scene): number {
  return LANES + ((height - RULER - LANES) * (index + 0.5)) / Math.max(walkers.length, 1);
}

/** Returns where a frame is on the screen; on a ruler, in the lane of the given agent. */
function screenAt(scene: Scene, frame: number, lane: number): Point | null {
  if (!scene.points) return { x: toScreen(scene.view, { x: frame, y: 0 }).x, y: laneOf(lane, scene) };
  const point = scene.map && pointAt(scene.map.index, scene.points, frame);
  return point ? toScreen(scene.view, point) : null;
}

function Track({ map, points, plane, first, count, path, selected, view, width, height }: Scene & { map: TraversalMap; points: readonly (Point | null)[] }): JSX.Element {
  const whole = useMemo(() => (plane ? '' : pathOf(points)), [plane, points]);
  const between = (from: number, to: number): string => pathOf(pointsBetween(map.index, points, from, to));
  const route = useMemo(() => (plane ? '' : between(first, first + count - 1)), [plane, points, first, count]);
  const walked = plane ? pathOf(path.map((state) => plane.states[state] ?? null)) : between(least(path), greatest(path));
  const bar = scaleBar(view, Math.min(160, width / 3));
  return (
    <>
      <g class="track" transform={`translate(${view.x} ${view.y}) scale(${view.scale})`}>
        <path d={whole} stroke="var(--map-rest)" stroke-width="3" />
        <path d={route} stroke="var(--map-route)" stroke-width="5" />
        <path d={walked} stroke={`var(--${seriesColour(selected)})`} stroke-width="5" />
      </g>
      <g class="scale" transform={`translate(16 ${height - 16})`}>
        <path d={`M0 -5V0H${bar.pixels}V-5`} />
        <text x={bar.pixels / 2} y="-8">
          {metres(bar.length)}
        </text>
      </g>
      <g class="scale" transform="translate(22 14)">
        <path d="M0 20V0M-5 6L0 0L5 6" />
        <text y="34">N</text>
      </g>
    </>
  );
}

function Ruler(scene: Scene): JSX.Element {
  const { map, first, count, frames, walkers, selected, path, view, width, height } = scene;
  const base = height - RULER + 8;
  const at = (frame: number): number => frame * view.scale + view.x;
  const line = (from: number, to: number, y: number, colour: string, thickness: number): JSX.Element => (
    <path d={`M${at(from)} ${y}H${at(to)}`} stroke={`var(--${colour})`} stroke-width={thickness} />
  );
  const from = Math.max(0, Math.ceil(-view.x / view.scale));
  const to = Math.min(frames - 1, Math.floor((width - view.x) / view.scale));
  const seen = ticks(from, to, width / 110).filter((frame) => at(frame) >= 20 && at(frame) <= width - 24); // no label is cut
  const along = (frame: number): number | null => (map?.position ? valueAt(map.index, map.position, frame) : null);
  const zero = along(0);
  const last = first + count - 1;
  return (
    <>
      {line(0, frames - 1, base, 'map-rest', 3)}
      {line(first, last, base, 'map-route', 5)}
      {walkers.map((_, i) => (i === selected ? line(first, last, laneOf(i, scene), 'line', 2) : line(first, last, laneOf(i, scene), 'line-soft', 1)))}
      {path.length > 1 && line(least(path), greatest(path), laneOf(selected, scene), seriesColour(selected), 4)}
      {seen.map((frame) => {
        const here = along(frame);
        return (
          <g key={frame} class="scale" transform={`translate(${at(frame)} ${base})`}>
            <path d="M0 0V7" />
            <text y="20">{integer(frame)}</text>
            {here !== null && zero !== null && <text y="34">{metres(here - zero)}</text>}
          </g>
        );
      })}
      <g class="scale" transform={`translate(20 ${base - 8})`}>
        <text>frame</text>
      </g>
    </>
  );
}

type SignName = 'agent' | 'start' | 'goal';

/** Draws the sign of an agent, or of its start or goal, in the current colour. */
function Sign({ name, at: { x, y }, size }: { name: SignName; at: Point; size: number }): JSX.Element {
  const half = 0.62 * size;
  if (name === 'start') return <rect class="sign hollow" x={x - half} y={y - half} width={2 * half} height={2 * half} />;
  return (
    <>
      <circle class={name === 'goal' ? 'sign hollow' : 'sign'} cx={x} cy={y} r={size} />
      {name === 'goal' && <circle cx={x} cy={y} r={0.38 * size} />}
    </>
  );
}

function WalkerSigns({ scene, walker, index }: { scene: Scene; walker: Walker; index: number }): JSX.Element | null {
  if (walker.idle) return null;
  const mine = index === scene.selected;
  const signs: [name: SignName, frame: number, word: string][] = [['agent', walker.position, walker.label]];
  // A map shows only the selected agent's start and goal: others would hide the route.
  if (mine || !scene.points) signs.unshift(['start', walker.start, 'start'], ['goal', walker.goal, 'goal']);
  const placed = signs.flatMap(([name, frame, word]) => {
    const place = name === 'goal' && scene.plane?.places[frame];
    const at = place ? toScreen(scene.view, place) : screenAt(scene, frame, index);
    return at ? [{ name, at, word }] : [];
  });
  const agent = placed.find(({ name }) => name === 'agent');
  const heading = scene.plane?.heading[walker.position];
  return (
    <g class="walker" style={{ color: `var(--${seriesColour(index)})` }}>
      {placed.map(({ name, at }) => (
        <Sign key={name} name={name} at={at} size={mine ? 8 : 5} />
      ))}
      {agent && heading !== undefined && <path d={mine ? 'M0 0V-20' : 'M0 0V-12'} transform={`translate(${agent.at.x} ${agent.at.y}) rotate(${heading})`} stroke="currentcolor" />}
      {mine &&
        scene.points &&
        placed.map(({ name, at, word }) => {
          const left = at.x > scene.width - 80; // there is no room to the right
          return (
            <text key={name} x={at.x + (left ? -12 : 12)} y={at.y - 8} text-anchor={left ? 'end' : 'start'}>
              {word}
            </text>
          );
        })}
    </g>
  );
}

/** Explains the signs of the map. */
export function RouteLegend({ belief = false }: { belief?: boolean }): JSX.Element {
  return (
    <ul class="legend" aria-label="Signs">
      {(['agent', 'start', 'goal'] as const).map((name) => (
        <li key={name} class="row">
          <svg class="walker" viewBox="0 0 14 14" width="14" height="14" aria-hidden="true">
            <Sign name={name} at={{ x: 7, y: 7 }} size={6} />
          </svg>
          {name}
        </li>
      ))}
      <li class="row">
        <Swatch colour="text-soft" /> path so far
      </li>
      {belief && (
        <li class="row">
          <Swatch colour="heat" /> where the agent believes to be
        </li>
      )}
    </ul>
  );
}
