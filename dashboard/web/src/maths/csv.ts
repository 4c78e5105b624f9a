// SPDX-License-Identifier: Apache-2.0
export type Cell = string | number | boolean | null | undefined;

/** RFC 4180; a cell that a spreadsheet would take for a formula is text there too. */
function csvCell(cell: Cell): string {
  if (cell === null || cell === undefined || (typeof cell === 'number' && Number.isNaN(cell))) return '';
  if (typeof cell === 'number') return String(cell);
  let text = String(cell);
  if (/^[=+\-@\t\r]/.test(text)) text = `'${text}`;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

export function csv(head: readonly string[], rows: readonly (readonly Cell[])[]): string {
  return [head, ...rows].map((row) => row.map(csvCell).join(',') + '\r\n').join('');
}

/** Turns a name into one of a file: letters, digits, dots and dashes. */
export function fileName(name: string): string {
  return name.replace(/[^\p{L}\p{N}.]+/gu, '-').replace(/^-+|-+$/g, '').toLowerCase() || 'data';
}

/** Lets the browser save a text as a file. */
export function download(name: string, text: string, type = 'text/csv'): void {
  const url = URL.createObjectURL(new Blob([text], { type: `${type};charset=utf-8` }));
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000); // a busy browser reads it later
}
