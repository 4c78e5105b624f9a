// SPDX-License-Identifier: Apache-2.0
import { spawn, type ChildProcess } from 'node:child_process';
import { once } from 'node:events';
import { closeSync, openSync, readFileSync } from 'node:fs';
import { join, resolve } from 'node:path';

/** The built page, and the folder of the build that it is in. */
export const PAGE = resolve(process.env.CITYLEARN_PAGE ?? '../../build/release/dashboard/page');
const BUILD = resolve(PAGE, '../..');

export type Options = Record<string, string | number | true | readonly string[]>;

const argumentsOf = (options: Options): string[] =>
  Object.entries(options).flatMap(([name, value]) => (value === true ? [`--${name}`] : [`--${name}`, ...(typeof value === 'object' ? value : [String(value)])]));

/** A program of the build, with its output in a file. */
export class Program {
  private constructor(
    private readonly child: ChildProcess,
    private readonly name: string,
    private readonly log: string,
  ) {}

  /** Starts BUILD/path. Its output goes to FOLDER/name.log. A program that is `nice` leaves the processors to the others. */
  static start(path: string, options: Options, { folder, name, nice = false }: { folder: string; name: string; nice?: boolean }): Program {
    const log = join(folder, `${name}.log`);
    const command = [...(nice ? ['nice', '-n', '19'] : []), join(BUILD, path), ...argumentsOf(options)];
    const out = openSync(log, 'w'); // not through a pipe: when the program has ended, all that it said is there
    const child = spawn(command[0] as string, command.slice(1), { stdio: ['ignore', out, out] });
    closeSync(out);
    return new Program(child, name, log);
  }

  get pid(): number {
    return this.child.pid ?? 0;
  }

  /** Whether it has ended. */
  get over(): boolean {
    return this.child.exitCode !== null || this.child.signalCode !== null;
  }

  /** Returns what the pattern finds in the output. Throws an Error with the output if the program ends before. */
  async says(pattern: RegExp): Promise<string> {
    for (;;) {
      const over = this.over;
      const text = readFileSync(this.log, { encoding: 'utf8', flag: 'a+' });
      const [found] = pattern.exec(text) ?? [];
      if (found !== undefined) return found;
      if (over) throw new Error(`${this.name} ended early:\n${text}`);
      await new Promise((done) => setTimeout(done, 20));
    }
  }

  /** Waits until it has ended. Throws an Error with its output unless it ended well. */
  async ended(): Promise<void> {
    if (!this.over) await once(this.child, 'exit');
    if (this.child.exitCode !== 0) throw new Error(`${this.name} failed:\n${readFileSync(this.log, 'utf8')}`);
  }

  async kill(signal: NodeJS.Signals = 'SIGTERM'): Promise<void> {
    if (this.over) return;
    const exit = once(this.child, 'exit');
    this.child.kill(signal);
    this.child.kill('SIGCONT');
    await exit;
  }
}

/** The dashboard's program. `link` is what it prints, `url` its page. */
export interface Dashboard {
  program: Program;
  link: string;
  url: string;
}

export async function startDashboard(options: Options, folder: string, { name = 'dashboard', store = true } = {}): Promise<Dashboard> {
  const records: Options = store ? { store: join(folder, `${name}.sqlite`) } : {};
  const program = Program.start('dashboard/dashboard', { port: 0, page: PAGE, ...records, ...options }, { folder, name });
  const link = await program.says(/http:\S+(?=\s)/);
  return { program, link, url: new URL('/', link).href };
}

/** Returns an answer of the dashboard's API. */
export async function api<T>(url: string, path: string): Promise<T> {
  return (await (await fetch(`${url}api/${path}`)).json()) as T;
}

/** Repeats a call until its result satisfies the condition, for at most a minute. */
export async function eventually<T>(what: () => Promise<T>, satisfies: (value: T) => boolean, limit = 60_000): Promise<T> {
  const end = Date.now() + limit;
  for (;;) {
    const value = await what();
    if (satisfies(value)) return value;
    if (Date.now() > end) throw new Error(`not within ${limit} ms; last: ${JSON.stringify(value)}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}
