// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useMemo } from 'preact/hooks';
import { runPath } from '../api/client';
import { TRAINING_FIGURES } from '../api/training_figures';
import type { Evaluation, Run, RunDetail } from '../api/types';
import { linesOf, type Display, type GroupRows } from '../maths/curves';
import { fixed, percent, short, significant, threeDecimals } from '../maths/format';
import { preferredGroup, type Group } from '../maths/groups';
import type { XAxis } from '../maths/rows';
import { isKnown } from '../maths/runs';
import type { Range } from '../maths/seeds';
import { useGroups } from '../state/groups';
import { useJson, valueOf } from '../state/resource';
import { param, place, setParams, usePinned } from '../state/router';
import { seriesColour } from '../state/theme';
import { useDetail, useTraining } from '../state/training';
import { Card, Failed, Loading } from '../ui/basics';
import { Chart, type Reference } from '../ui/chart';
import { AXIS, axisProps, Choice, chosen, GROUPS, type ChoiceOf } from '../ui/choice';
import { RunPicker } from '../ui/run_picker';
import { WithRuns } from '../ui/with_runs';

interface Metric {
  key: string;
  title: string;
  hint: string;
  unit: string;
  format: (value: number | null) => string;
  max?: number;
}

const PERFORMANCE: Metric[] = [
  { key: 'reward', title: 'Reward', hint: 'mean of the last 100 episodes', unit: '', format: threeDecimals },
  { key: 'spl', title: 'SPL', hint: 'success weighted by path length, last 100 episodes', unit: '', format: threeDecimals, max: 1 },
  { key: 'episode_length', title: 'Episode length', hint: 'steps, mean of the last 100 episodes', unit: 'steps', format: (v) => fixed(v, 1) },
];
const FORMATS: { [unit: string]: Metric['format'] } = { share: percent, 'steps/s': short };
const AXES = ['update', 'steps', 'episodes', 'wall'];
const OPTIMISATION: Metric[] = TRAINING_FIGURES.filter(
  ({ name }) => !AXES.includes(name) && !PERFORMANCE.some(({ key }) => key === name),
).map(({ name, unit, title, help }) => ({ key: name, title, hint: help, unit: FORMATS[unit] ? '' : unit, format: FORMATS[unit] ?? significant }));

const MAX_RUNS = 24; // curves fetched at once

const SEEDS: ChoiceOf<Display> = { name: 'show', label: 'Seeds', values: { both: 'Both', mean: 'Mean and spread', runs: 'Each' } };

export function TrainingPage(): JSX.Element {
  return (
    <WithRuns
      title="Runs"
      empty={
        <>
          Curves appear with the first update of a policy_service. <code>citylearn demo</code> starts one.
        </>
      }
    >
      {(all) => <Training all={all} />}
    </WithRuns>
  );
}

function shownGroups(groups: readonly Group[]): Group[] {
  const { params } = place.value;
  const wanted = params.get('groups');
  if (wanted !== null) {
    const keys = new Set(wanted.split('\n'));
    return groups.filter((group) => keys.has(group.key));
  }
  const run = params.get('runs');
  const found = groups.filter((group) => (run ? group.runs.some((one) => one.id === run) : false));
  const first = preferredGroup(groups);
  return found.length || !first ? found : [first];
}

/** Returns the part of the horizontal axis that the address names; null: all of it. */
function zoomOf(): Range | null {
  const [from, to] = [Number(param('from', 'NaN')), Number(param('to', 'NaN'))];
  return Number.isFinite(from) && Number.isFinite(to) && from < to ? { from, to } : null;
}

function setZoom(zoom: Range | null): void {
  setParams({ from: zoom && String(zoom.from), to: zoom && String(zoom.to) });
}

function Training({ all }: { all: readonly Run[] }): JSX.Element {
  const by = chosen(GROUPS);
  const x = chosen(AXIS);
  const display = chosen(SEEDS);
  const smoothing = Math.min(Math.max(Number(param('smooth', '0.9')) || 0, 0), 0.999);
  const hidden = useMemo(() => new Set(param('hide', '').split('\n').filter(Boolean)), [place.value]);
  const zoom = useMemo(zoomOf, [param('from', ''), param('to', '')]);
  const groups = useGroups(all, by);
  const shown = shownGroups(groups);
  // Its newest run stands for a group, as runs may be grouped otherwise once their manifests are known.
  const [newest] = [...(shown[0]?.runs ?? [])].sort((a, b) => (b.started ?? 0) - (a.started ?? 0));
  usePinned('runs', newest && isKnown(newest) ? newest.id : null, place.value.params.has('groups'));
  let room = MAX_RUNS;
  const fitting = shown.filter((group) => (room -= group.runs.length) >= 0 || group === shown[0]);
  const ids = fitting.flatMap((group) => group.runs.map((run) => run.id));
  const training = useTraining(ids);
  const versions = ids.map((id) => training.get(id)?.version ?? 0).join();
  // A zoomed part of a decimated run is fetched with all of its points. It begins further left, where the smoothing starts.
  const decimated = zoom ? ids.filter((id) => training.get(id)?.rows.decimated) : [];
  const detail = useDetail(decimated, zoom && { x, from: Math.max(0, 2 * zoom.from - zoom.to), to: zoom.to });
  const chosenIds = fitting.flatMap((group) => group.runs.map((run) => run.id)).join('\n');
  const coloured = useMemo(() => coloursOf(fitting, true), [chosenIds, by]);

  const groupRows: GroupRows[] = useMemo(
    () =>
      fitting.map((group, g) => ({
        key: group.key,
        label: group.label,
        colour: seriesColour(g),
        runs: group.runs.flatMap((run) => {
          const rows = detail.get(run.id) ?? training.get(run.id)?.rows;
          return rows?.length
            ? [{ id: run.id, label: `seed ${run.seed ?? '?'}`, colour: coloured.get(run.id) ?? 'series-1', rows }]
            : [];
        }),
      })),
    [versions, chosenIds, by, coloured, detail],
  );

  const states = ids.map((id) => training.get(id)?.state);
  const failed = ids.map((id) => training.get(id)).find((one) => one?.state === 'failed');
  const references = useReferences(fitting[0]?.runs[0]);
  const charts = (list: readonly Metric[]): JSX.Element[] =>
    list.map((metric) => (
      <MetricChart
        key={metric.key}
        metric={metric}
        groups={groupRows}
        options={{ x, smoothing, display, hidden }}
        references={references[metric.key] ?? []}
        zoom={zoom}
        onZoom={setZoom}
      />
    ));
  return (
    <div class="columns with-picker">
      <RunPicker
        groups={groups}
        shown={new Set(fitting.map((group) => group.key))}
        hidden={hidden}
        colours={coloursOf(fitting, display === 'runs')}
        omitted={shown.length - fitting.length}
      />
      <div class="stack">
        <div class="wrap card">
          <Choice of={{ ...AXIS, resets: ['from', 'to'] }} />
          <Choice of={SEEDS} />
          <label class="field hint">
            <span>
              Smoothing <b>{smoothing.toFixed(2)}</b>
            </span>
            <input
              type="range"
              min={0}
              max={0.99}
              step={0.01}
              value={smoothing}
              aria-valuetext={smoothing.toFixed(2)}
              onInput={(event) => setParams({ smooth: event.currentTarget.value })}
            />
          </label>
          {zoom && (
            <button type="button" onClick={() => setZoom(null)}>
              Whole range
            </button>
          )}
        </div>
        {failed && <Failed error={failed.error} />}
        {groupRows.every((group) => group.runs.length === 0) && states.includes('loading') ? (
          <Card title="Curves">
            <Loading lines={6} />
          </Card>
        ) : (
          <>
            <div class="tiles charts charts-main">{charts(PERFORMANCE)}</div>
            <h2>Optimisation</h2>
            <div class="tiles charts">{charts(OPTIMISATION)}</div>
          </>
        )}
      </div>
    </div>
  );
}

/** Returns run ID -> colour: one for each run, or one for each group. */
function coloursOf(groups: readonly Group[], each: boolean): Map<string, string> {
  let n = 0;
  return new Map(groups.flatMap((group, g) => group.runs.map((run) => [run.id, seriesColour(each ? n++ : g)] as const)));
}

function MetricChart({ metric, groups, options, references, zoom, onZoom }: {
  metric: Metric;
  groups: readonly GroupRows[];
  options: { x: XAxis; smoothing: number; display: Display; hidden: ReadonlySet<string> };
  references: readonly Reference[];
  zoom: Range | null;
  onZoom: (range: Range | null) => void;
}): JSX.Element {
  const { x, smoothing, display, hidden } = options;
  const lines = useMemo(
    () => linesOf(groups, { metric: metric.key, x, smoothing, display, hidden, range: zoom }),
    [groups, metric.key, x, smoothing, display, hidden, zoom],
  );
  return (
    <Chart
      title={metric.title}
      hint={metric.hint}
      name="training"
      {...axisProps(x)}
      yLabel={[metric.title, metric.unit].filter(Boolean).join(', ')}
      format={metric.format}
      max={metric.max}
      lines={lines}
      references={references}
      zoom={zoom}
      onZoom={onZoom}
      sync="training"
      height={PERFORMANCE.includes(metric) ? 260 : 200}
    />
  );
}

const REFERENCES = ['shortest_path', 'blind', 'sequence_filter'];

/** Returns the results of policies that learn nothing, where they were evaluated on the traversal of the training, as lines. */
function useReferences(run: Run | undefined): Partial<Record<string, Reference[]>> {
  const train = valueOf(useJson<RunDetail>(run ? runPath(run.id) : null))?.manifest?.train;
  const evaluations = useJson<{ evaluations: Evaluation[] }>(run ? runPath(run.id, '/evaluations') : null, run?.state);
  return useMemo(() => {
    const all = valueOf(evaluations)?.evaluations ?? [];
    const found = REFERENCES.flatMap((policy) => {
      const own = all.filter((one) => one.policy === policy && !one.shuffled);
      return own.find(({ traversal }) => traversal === train) ?? own[0] ?? [];
    });
    const lines = (of: (one: Evaluation) => number): Reference[] =>
      found.map((one) => ({ label: `${one.policy.replaceAll('_', ' ')}, ${one.traversal}`, value: of(one) }));
    return { reward: lines((one) => one.reward), spl: lines((one) => one.spl), episode_length: lines((one) => one.mean_steps) };
  }, [evaluations, train]);
}
