// SPDX-License-Identifier: Apache-2.0
import type { JSX } from 'preact';
import { useLayoutEffect, useRef } from 'preact/hooks';
import type { View } from '../maths/geometry';
import { eachVisible, type StreetPlane } from '../maths/streets';
import { colour, shown } from '../state/theme';

/** Draws streets beneath a map. A canvas, as a city has tens of thousands of lines. */
export function StreetCanvas({ plane, view, width, height }: { plane: StreetPlane; view: View; width: number; height: number }): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  const theme = shown.value;
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
    pen.beginPath();
    eachVisible(plane, view, width, height, (x1, y1, x2, y2) => {
      pen.moveTo(x1, y1);
      pen.lineTo(x2, y2);
    });
    pen.stroke();
  }, [plane, view, width, height, theme]);
  return <canvas class="streets" ref={canvas} style={{ height: `${height}px` }} aria-hidden="true" />;
}
