// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { csv, fileName } from '../../src/maths/csv';
import { bytes, clock, dateTime, duration, fixed, integer, metres, percent, plural, short, significant } from '../../src/maths/format';

describe('formatters', () => {
  it('unknown is a dash', () => {
    for (const format of [integer, short, significant, duration, bytes, metres]) expect(format(null)).toBe('–');
    expect(fixed(NaN, 2)).toBe('–');
    expect(percent(undefined)).toBe('–');
    for (const format of [clock, dateTime]) expect(format(1e300)).toBe('–'); // no date
  });
  it.each([
    [0, '0'],
    [0.5, '0.5'],
    [3, '3'],
    [9.99, '9.99'],
    [950, '950'],
    [999.99, '1k'],
    [12_345, '12.3k'],
    [4_560_000, '4.56M'],
    [-2000, '-2k'],
  ])('short(%d)', (value, text) => expect(short(value)).toBe(text));
  it.each([
    [0, '0'],
    [0.0015, '0.0015'],
    [-0.00201, '−0.00201'],
    [12.3456, '12.3'],
    [123456, '123456'],
    [0.0000123, '1.23e−5'],
    [12_345_678, '1.23e7'],
  ])('significant(%d)', (value, text) => expect(significant(value)).toBe(text));
  it.each([
    [0.85, '850 ms'],
    [12.34, '12.3 s'],
    [245, '4 min 05 s'],
    [59.97, '1 min 00 s'],
    [11_520, '3 h 12 min'],
    [3_599.9, '1 h 00 min'],
    [187_200, '2 d 4 h'],
  ])('duration(%d)', (value, text) => expect(duration(value)).toBe(text));
  it('rounds what lies between two decimals to the even one, as the services do in the terminal', () => {
    expect(percent(361 / 400)).toBe('90.2 %'); // 90.25
    expect(percent(363 / 400)).toBe('90.8 %'); // 90.75
    expect(fixed(0.0625, 3)).toBe('0.062');
    expect(fixed(-0.0625, 3)).toBe('−0.062');
    expect(fixed(2.5, 0)).toBe('2');
    expect(fixed(3.5, 0)).toBe('4');
    expect(fixed(0.15, 1)).toBe('0.1'); // is a little less than it looks
    expect(fixed(0.25 + 1e-12, 1)).toBe('0.3');
  });
  it('fractions, sizes, lengths, counts', () => {
    expect(percent(1)).toBe('100 %');
    expect(percent(0.9746)).toBe('97.5 %');
    expect(bytes(7_340_032)).toBe('7 MiB');
    expect(bytes(12)).toBe('12 B');
    expect(metres(500)).toBe('500 m');
    expect(metres(2816)).toBe('2.82 km');
    expect(integer(1234567)).toBe('1,234,567');
    expect(plural(1, 'seed')).toBe('1 seed');
    expect(plural(5, 'seed')).toBe('5 seeds');
  });
});

describe('csv', () => {
  it('quotes what must be quoted', () => {
    expect(csv(['a', 'b,c'], [['x"y', 'two\nlines'], [1.5, null]])).toBe('a,"b,c"\r\n"x""y","two\nlines"\r\n1.5,\r\n');
  });
  it('keeps numbers whole, unknown ones empty, and formulas harmless', () => {
    expect(csv(['v'], [[-0.1 + 0.3], [NaN], [true], ['=1+1']])).toBe("v\r\n0.19999999999999998\r\n\r\ntrue\r\n'=1+1\r\n");
  });
  it('file names', () => {
    expect(fileName('training Episode length')).toBe('training-episode-length');
    expect(fileName('../../etc/passwd')).toBe('..-..-etc-passwd');
    expect(fileName('///')).toBe('data');
  });
});
