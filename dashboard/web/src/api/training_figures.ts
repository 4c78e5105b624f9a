// SPDX-License-Identifier: Apache-2.0
import table from '../../../../core/task/training_figures.inc?raw';

const TEXT = '"((?:[^"]*))"';
const LINE = new RegExp(`^(?:FIGURE|LEARNED)\\((\\w+), ${TEXT}, ${TEXT}, ${TEXT},`, 'gm');

/** The figures of a training update, in the order of the C++ table, which is that of the API's columns and says what the fields mean. */
export const TRAINING_FIGURES = [...table.matchAll(LINE)].map(
  ([, name = '', unit = '', title = '', help = '']) => ({ name, unit, title, help }),
);
export const TRAINING_COLUMNS: readonly string[] = TRAINING_FIGURES.map(({ name }) => name);
