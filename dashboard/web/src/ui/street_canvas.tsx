// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useLayoutEffect, useRef } from 'preact/hooks';
import type { View } from '../maths/geometry';
import { visibleStreets, type StreetPlane } from '../maths/streets';
import { colour, isDark } from '../state/theme';

const DETAIL = 1.5; // pixels: corners that are nearer are not drawn

/** Draws streets beneath a map. On a canvas, and each by itself: one path of a whole city takes ten times as long. */
export function StreetCanvas({ plane, view, width, height }: { plane: StreetPlane; view: View; width: number; height: number }): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  const dark = isDark.value;
  useLayoutEffect(() => {
    const pen = canvas.current?.getContext('2d');
    if (!canvas.current || !pen) return;
    const ratio = window.devicePixelRatio;
    canvas.current.width = width * ratio;
    canvas.current.height = height * ratio;
    const scale = ratio * view.scale;
    pen.setTransform(scale, 0, 0, scale, ratio * view.x, ratio * view.y);
    pen.lineWidth = 1.5 / view.scale;
    pen.strokeStyle = colour('map-rest');
    for (const { points } of visibleStreets(plane, view, width, height)) {
      pen.beginPath();
      let drawn = points[0];
      points.forEach((point, i) => {
        const near = drawn && i > 0 && i < points.length - 1 && (Math.abs(point.x - drawn.x) + Math.abs(point.y - drawn.y)) * view.scale < DETAIL;
        if (near) return;
        pen.lineTo(point.x, point.y);
        drawn = point;
      });
      pen.stroke();
    }
  }, [plane, view, width, height, dark]);
  return <canvas class="streets" ref={canvas} style={{ height: `${height}px` }} aria-hidden="true" />;
}
