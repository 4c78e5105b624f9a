// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import { csv, download, fileName, type Cell } from '../maths/csv';
import { IconButton, classes } from './basics';

export interface Column<T> {
  key: string;
  label: string;
  /** Returns what a cell shows. */
  show: (row: T) => ComponentChildren;
  /** Returns the value for the CSV. Columns without it are not saved. */
  cell?: (row: T) => Cell;
  number?: boolean;
  wide?: boolean;
  /** The label is for screen readers only. */
  quiet?: boolean;
}

interface TableProps<T> {
  caption: string;
  columns: readonly Column<T>[];
  rows: readonly T[];
  rowKey: (row: T, index: number) => string | number;
  rowClass?: (row: T) => string | undefined;
  showCaption?: boolean;
}

/** A table that scrolls on its own where there is no room for it. */
export function Table<T>({ caption, columns, rows, rowKey, rowClass, showCaption }: TableProps<T>): JSX.Element {
  return (
    <div class="table-room" role="group" aria-label={caption} tabIndex={0}>
      <table>
        <caption class={classes(!showCaption && 'visually-hidden')}>{caption}</caption>
        <thead>
          <tr>
            {columns.map((column) => (
              <th key={column.key} scope="col" class={classes(column.number && 'number', column.wide && 'wide')}>
                {column.quiet ? <span class="visually-hidden">{column.label}</span> : column.label}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map((row, i) => (
            <tr key={rowKey(row, i)} class={rowClass?.(row)}>
              {columns.map((column, c) =>
                c === 0 ? (
                  <th key={column.key} scope="row" class={classes(column.number && 'number')}>
                    {column.show(row)}
                  </th>
                ) : (
                  <td key={column.key} class={classes(column.number && 'number', column.wide && 'wide')}>
                    {column.show(row)}
                  </td>
                ),
              )}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

export function saveTable<T>(name: string, columns: readonly Column<T>[], rows: readonly T[]): void {
  const there = columns.filter((column) => column.cell);
  download(
    `${fileName(name)}.csv`,
    csv(
      there.map((column) => column.key),
      rows.map((row) => there.map((column) => column.cell?.(row))),
    ),
  );
}

export function SaveTable<T>({ name, columns, rows }: {
  name: string;
  columns: readonly Column<T>[];
  rows: readonly T[];
}): JSX.Element {
  return <IconButton icon="save" label={`Download ${name} as CSV`} onClick={() => saveTable(name, columns, rows)} />;
}
