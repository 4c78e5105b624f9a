// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import { csv, download, fileName, type Cell } from '../maths/csv';
import type { Resource } from '../state/resource';
import { Card, classes, IconButton, Show } from './basics';

export interface Column<T> {
  /** Its name in the CSV. */
  key: string;
  label: string;
  /** Returns the value for the CSV. Columns without it are not saved. */
  cell?: (row: T) => Cell;
  /** Returns what a cell shows; without it, the value for the CSV. */
  show?: (row: T) => ComponentChildren;
  number?: boolean;
  wide?: boolean;
  /** The label is for screen readers only. */
  quiet?: boolean;
  /** The column is in the CSV only. */
  hidden?: boolean;
}

/** Returns a column of a field as it is. */
export function text<K extends string>(key: K, label: string): Column<Record<K, Cell>> {
  return { key, label, cell: (row) => row[key] };
}

/** Returns a column of a number, which is saved as it is and shown as `format` writes it. */
export function figure<K extends string, V extends Cell>(
  key: K,
  label: string,
  format: (value: V) => string,
): Column<Record<K, V>> {
  return { key, label, number: true, cell: (row) => row[key], show: (row) => format(row[key]) };
}

interface TableProps<T> {
  caption: string;
  columns: readonly Column<T>[];
  rows: readonly T[];
  rowKey: (row: T, index: number) => string | number;
  rowClass?: (row: T) => string | undefined;
}

/** A table that scrolls on its own where there is no room for it. */
export function Table<T>({ caption, columns, rows, rowKey, rowClass }: TableProps<T>): JSX.Element {
  const seen = columns.filter((column) => !column.hidden);
  const classOf = (column: Column<T>): string => classes(column.number && 'number', column.wide && 'wide');
  return (
    <div class="table-room scrolls" role="group" aria-label={caption} tabIndex={0}>
      <table>
        <caption class="visually-hidden">{caption}</caption>
        <thead>
          <tr>
            {seen.map((column) => (
              <th key={column.key} scope="col" class={classOf(column)}>
                {column.quiet ? <span class="visually-hidden">{column.label}</span> : column.label}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map((row, i) => (
            <tr key={rowKey(row, i)} class={rowClass?.(row)}>
              {seen.map((column, c) => {
                const Cell = c === 0 ? 'th' : 'td';
                return (
                  <Cell key={column.key} scope={c === 0 ? 'row' : undefined} class={classOf(column)}>
                    {(column.show ?? column.cell)?.(row)}
                  </Cell>
                );
              })}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

export function SaveTable<T>({ name, columns, rows }: { name: string } & Pick<TableProps<T>, 'columns' | 'rows'>): JSX.Element {
  const save = (): void => {
    const saved = columns.filter((column) => column.cell);
    const cells = rows.map((row) => saved.map((column) => column.cell?.(row)));
    download(`${fileName(name)}.csv`, csv(saved.map((column) => column.key), cells));
  };
  return <IconButton icon="save" label={`Download ${name} as CSV`} onClick={save} />;
}

interface TableCardProps<T> extends Omit<TableProps<T>, 'caption'> {
  title: string;
  /** Of the table; the title by default. */
  caption?: string;
  hint?: string | undefined;
  id?: string;
  /** Name of the saved file. */
  name: string;
  actions?: ComponentChildren;
  /** What the rows are made of, if they are fetched. */
  of?: Resource<unknown>;
  /** The rows of the CSV, where they are more than those that are shown. */
  saved?: readonly T[];
  /** Shown when there are no rows. */
  empty?: ComponentChildren;
  below?: ComponentChildren;
  children?: ComponentChildren;
}

/** A card with a table, which can be saved as CSV, below its children. */
export function TableCard<T>({ title, hint, id, name, actions, of, saved, empty, below, children, ...table }: TableCardProps<T>): JSX.Element {
  return (
    <Card
      title={title}
      hint={hint}
      id={id}
      actions={
        <>
          {actions}
          <SaveTable name={name} columns={table.columns} rows={saved ?? table.rows} />
        </>
      }
    >
      {children}
      <Show of={of ?? { state: 'ready', value: null }} lines={6}>
        {() =>
          table.rows.length || !empty ? (
            <>
              <Table caption={title} {...table} />
              {below}
            </>
          ) : (
            empty
          )
        }
      </Show>
    </Card>
  );
}
