// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { integer, significant } from '../maths/format';
import type { XAxis } from '../maths/rows';
import type { Range } from '../maths/seeds';
import { cursorAt, setCursor } from '../state/cursor';
import { useLoggedLines, useMetrics, type Drawn } from '../state/logged';
import { param, setParams } from '../state/router';
import { Card, Empty, Loading } from './basics';
import { Chart } from './chart';
import { axisProps } from './choice';

const MOST_CHARTS = 12;

interface LoggedChartsProps {
  drawn: readonly Drawn[];
  x: XAxis;
  smoothing: number;
  zoom: Range | null;
  onZoom: (range: Range | null) => void;
}

/** The metrics of logged runs, each a chart with a line a run. Of many metrics those are shown whose names match a text. */
export function LoggedCharts({ drawn, x, smoothing, zoom, onZoom }: LoggedChartsProps): JSX.Element {
  const wanted = param('metrics', '');
  const all = useMetrics(drawn.map(({ run }) => run));
  const matching = (all ?? []).filter((name) => name.toLowerCase().includes(wanted.toLowerCase()));
  const shown = matching.slice(0, MOST_CHARTS);
  const lines = useLoggedLines(drawn, shown, { x, smoothing, zoom });
  if (all === null)
    return (
      <Card title="Logged metrics">
        <Loading lines={6} />
      </Card>
    );
  return (
    <>
      <h2>Logged metrics</h2>
      {(all.length > MOST_CHARTS || wanted) && (
        <div class="wrap card">
          <label class="field hint">
            <span>Find metrics</span>
            <input type="search" value={wanted} onInput={(event) => setParams({ metrics: event.currentTarget.value || null })} />
          </label>
          <p class="hint">
            {integer(shown.length)} of {integer(all.length)} metrics
          </p>
        </div>
      )}
      {shown.length === 0 && (
        <Card title="Curves">
          <Empty title={all.length ? 'No metric has this in its name' : 'Nothing is logged yet'} />
        </Card>
      )}
      <div class="tiles charts">
        {shown.map((metric) => (
          <Chart
            key={metric}
            title={metric}
            name="logged"
            {...axisProps(x === 'episodes' ? 'steps' : x)}
            yLabel={metric}
            format={(value) => significant(value)}
            lines={lines.get(metric) ?? []}
            zoom={zoom}
            onZoom={onZoom}
            sync="training"
            mark={cursorAt()}
            onMark={setCursor}
            height={200}
          />
        ))}
      </div>
    </>
  );
}
