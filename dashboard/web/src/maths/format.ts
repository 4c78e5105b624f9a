// SPDX-License-Identifier: Apache-2.0
const NONE = '–';

// Made once: toLocaleString() makes one for each call, which takes seconds for a table of thousands of cells.
const INTEGER = new Intl.NumberFormat('en-US');
const CLOCK = new Intl.DateTimeFormat('en-GB', { timeStyle: 'medium' });
const DATE_TIME = new Intl.DateTimeFormat('sv-SE', { dateStyle: 'short', timeStyle: 'short' });

function known(value: number | null | undefined): value is number {
  return value !== null && value !== undefined && Number.isFinite(value);
}

/** 1,234,567 */
export function integer(value: number | null | undefined): string {
  return known(value) ? INTEGER.format(Math.round(value)) : NONE;
}

/** 950, 12.3k, 4.56M */
export function short(value: number | null | undefined): string {
  if (!known(value)) return NONE;
  const size = Math.abs(value);
  for (const [unit, name] of [[1e9, 'G'], [1e6, 'M'], [1e3, 'k']] as const)
    if (size >= unit * 0.99995) return trim((value / unit).toPrecision(3)) + name;
  return size !== 0 && size < 1 ? significant(value) : trim(value.toFixed(size < 10 ? 2 : size < 100 ? 1 : 0));
}

function trim(text: string): string {
  return text.includes('.') && !text.includes('e') ? text.replace(/\.?0+$/, '') : text;
}

/** Three significant digits, exponents only where they are shorter to read. */
export function significant(value: number | null | undefined): string {
  if (!known(value)) return NONE;
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e7 || size < 1e-4) return value.toExponential(2).replace('e+', 'e').replace('-', '−').replace('e-', 'e−');
  return minus(trim(Number(value.toPrecision(Math.max(3, Math.ceil(Math.log10(size))))).toString()));
}

export function fixed(value: number | null | undefined, digits: number): string {
  return known(value) ? minus(rounded(value, digits)) : NONE;
}

const MORE = 25; // digits that show whether a number lies exactly between two decimals

/** Rounds a number that lies exactly between two decimals to the even one, as C++ and Python do. toFixed() does not. */
function rounded(value: number, digits: number): string {
  const exact = value.toFixed(digits + MORE);
  const below = exact.slice(0, -MORE).replace(/\.$/, '');
  const between = /^50*$/.test(exact.slice(-MORE));
  return between && Number(below.at(-1)) % 2 === 0 ? below : value.toFixed(digits);
}

export function threeDecimals(value: number | null | undefined): string {
  return fixed(value, 3);
}

/** Fraction as 97.5 % */
export function percent(value: number | null | undefined): string {
  if (!known(value)) return NONE;
  return `${fixed(100 * value, value === 0 || value === 1 ? 0 : 1)} %`;
}

function minus(text: string): string {
  return text.replace(/^-/, '−');
}

/** Seconds as 850 ms, 12.3 s, 4 min 05 s, 3 h 12 min, 2 d 4 h */
export function duration(seconds: number | null | undefined): string {
  if (!known(seconds)) return NONE;
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 59.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, '0')} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 48 * 60) return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, '0')} min`;
  const hours = Math.round(seconds / 3600);
  return `${Math.floor(hours / 24)} d ${hours % 24} h`;
}

export function bytes(value: number | null | undefined): string {
  if (!known(value)) return NONE;
  for (const [unit, name] of [[2 ** 30, 'GiB'], [2 ** 20, 'MiB'], [2 ** 10, 'KiB']] as const)
    if (value >= unit) return `${trim((value / unit).toPrecision(3))} ${name}`;
  return `${value} B`;
}

/** Metres as 40 m, 1.2 km */
export function metres(value: number | null | undefined): string {
  if (!known(value)) return NONE;
  return value >= 1000 ? `${trim((value / 1000).toPrecision(3))} km` : `${trim(value.toPrecision(3))} m`;
}

/** Returns whether there is a date for a time: services may say any. */
function dated(seconds: number | null | undefined): seconds is number {
  return known(seconds) && Math.abs(seconds) <= 8.64e12;
}

/** Time of day, local: 14:03:07 */
export function clock(seconds: number | null | undefined): string {
  return dated(seconds) ? CLOCK.format(seconds * 1000) : NONE;
}

/** 2026-03-04 14:03, local. */
export function dateTime(seconds: number | null | undefined): string {
  return dated(seconds) ? DATE_TIME.format(seconds * 1000) : NONE;
}

export function plural(count: number, one: string): string {
  return `${integer(count)} ${one}${count === 1 ? '' : 's'}`;
}
