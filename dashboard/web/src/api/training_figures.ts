// SPDX-License-Identifier: Apache-2.0
import table from '../../../../core/task/training_figures.inc?raw';

/** A figure of one training update; the C++ table says what the fields mean. */
export interface TrainingFigure {
  name: string;
  unit: string;
  title: string;
  help: string;
}

const TEXT = '"((?:[^"]*))"';
const LINE = new RegExp(`^(?:FIGURE|LEARNED)\\((\\w+), ${TEXT}, ${TEXT}, ${TEXT},`, 'gm');

/** All figures, in the order of the C++ table, which is that of the API's columns. */
export const TRAINING_FIGURES: readonly TrainingFigure[] = [...table.matchAll(LINE)].map(
  ([, name = '', unit = '', title = '', help = '']) => ({ name, unit, title, help }),
);
export const TRAINING_COLUMNS: readonly string[] = TRAINING_FIGURES.map(({ name }) => name);
