// SPDX-License-Identifier: Apache-2.0
import { createHash } from 'node:crypto';
import { readFileSync, existsSync } from 'node:fs';
import { createServer, type IncomingMessage, type Server, type ServerResponse } from 'node:http';
import type { AddressInfo, Socket } from 'node:net';
import { extname, join, normalize } from 'node:path';
import { WebSocketServer, WebSocket } from 'ws';
import type { Run, Services } from '../src/api/types';
import { compared } from './compare';
import { view, matrix } from './pictures';
import { CONTROLS, FIRST, PLACES, recognition, World, type RunData } from './world';

export interface MockOptions {
  port: number;
  /** Folder of the built page. */
  page: string;
  /** Requires this token. */
  token?: string;
  /** Has no runs. */
  empty?: boolean;
  /** Is put before every text that does not come from the dashboard itself, to attack the page. */
  mark?: string;
}

const CSP =
  "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; style-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
const TYPES: Record<string, string> = {
  '.html': 'text/html; charset=utf-8',
  '.js': 'text/javascript; charset=utf-8',
  '.css': 'text/css; charset=utf-8',
  '.svg': 'image/svg+xml',
  '.woff2': 'font/woff2',
};

/** The parameters of each resource. Others are an error, as they are for the server. */
const PARAMETERS: Record<string, string[]> = {
  training: ['columns', 'points', 'x', 'from', 'to'],
  episodes: ['limit', 'before', 'until', 'evaluation', 'traversal', 'policy', 'update', 'shuffled', 'completed', 'order'],
  events: ['limit'],
  frames: ['nearest'],
  controls: ['frames', 'max_steps'],
  compare: ['runs', 'all'],
  matrix: ['file'],
};

/** Texts of the dashboard itself, by their keys, and one that the page looks for. All others come from services and files. */
const OWN = ['hash', 'incarnation', 'kind', 'state'];
const CONTROL = 'sequence_filter';

const ORDERS: Record<string, string> = { updates: 'update', episodes: 'episodes', steps: 'steps', wall: 'wall' };

class HttpError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

/** Returns the first of the list that `is` accepts. Throws HttpError 404 with the text `otherwise` if there is none. */
function found<T>(list: readonly T[], is: (one: T) => boolean, otherwise: string): T {
  const one = list.find(is);
  if (!one) throw new HttpError(404, otherwise);
  return one;
}

interface Client {
  socket: WebSocket;
  /** What it watches, and how it called that. */
  topics: Map<string, string>;
  sequence: number;
}

interface Reply {
  type: string;
  body: Buffer | string;
  cache?: string;
}

/** Imitates a dashboard as docs/reference/dashboard-api.md describes it. */
export class Mock {
  readonly world: World;
  private readonly server: Server;
  private readonly sockets = new WebSocketServer({ noServer: true });
  private readonly clients = new Set<Client>();
  private readonly connections = new Set<Socket>();
  private readonly timers: ReturnType<typeof setInterval>[] = [];
  private readonly cookie: string;
  private silent = false;
  /** Requests so far, as lines: "GET /api/runs". */
  readonly asked: string[] = [];

  private constructor(private readonly options: MockOptions) {
    this.world = new World(options.empty);
    this.cookie = createHash('sha256').update(`cookie ${options.token ?? ''}`).digest('hex').slice(0, 32);
    this.server = createServer((request, response) => this.serve(request, response));
    this.server.on('connection', (socket) => {
      this.connections.add(socket);
      socket.on('close', () => this.connections.delete(socket));
      if (this.silent) socket.destroy();
    });
    this.server.on('upgrade', (request, socket, head) => {
      if (request.url !== '/api/live' || !this.knows(request)) {
        socket.end('HTTP/1.1 401 Unauthorized\r\nConnection: close\r\n\r\n');
        return;
      }
      this.sockets.handleUpgrade(request, socket, head, (socket) => this.join(socket));
    });
  }

  static async start(options: MockOptions): Promise<Mock> {
    const mock = new Mock(options);
    await new Promise<void>((resolve, reject) => {
      mock.server.once('error', reject);
      mock.server.listen(options.port, '127.0.0.1', resolve);
    });
    mock.run();
    return mock;
  }

  get url(): string {
    return `http://127.0.0.1:${(this.server.address() as AddressInfo).port}/`;
  }

  async stop(): Promise<void> {
    this.timers.forEach((timer) => clearInterval(timer));
    this.silence();
    await new Promise((resolve) => this.server.close(resolve));
  }

  /** Cuts every connection and refuses new ones, as a dashboard that was killed. */
  silence(): void {
    this.silent = true;
    for (const client of this.clients) client.socket.terminate();
    for (const socket of this.connections) socket.destroy();
  }

  answer(): void {
    this.silent = false;
  }

  lose(id: string): void {
    this.change(id, 'lost', 'no heartbeat for 3 s', { state: 'lost' });
  }

  bring(id: string): void {
    this.change(id, 'back', 'heartbeats arrive again', { state: 'running' });
  }

  /** The service reports a fault, or with an empty text that it is over. */
  alarm(id: string, text: string): void {
    this.change(id, 'alarm', text || 'resolved', { alarm: text });
  }

  private change(...what: Parameters<World['change']>): void {
    if (this.world.services.length === 0) return;
    this.sendJson('events', this.world.change(...what));
    this.sendServices();
  }

  private run(): void {
    let ticks = 0;
    this.timers.push(
      setInterval(() => {
        ticks += 1;
        this.world.tick();
        const watched = new Set(this.watched());
        for (const scene of this.world.scenes) {
          const { agents, traversal, mode, step } = scene;
          const header = { traversal: this.mark + traversal.name, hash: traversal.hash, first_frame: FIRST, frames: PLACES, step, mode, policy: `${this.mark}place_filter`, agents: agents.length };
          const fields = (['position', 'position', 'start', 'goal', 'steps', 'flags'] as const).flatMap((name) => agents.map((agent) => agent[name]));
          const topic = `${scene.environment}@demo-2211`;
          this.send(`scene:${topic}`, header, Buffer.from(Uint32Array.from(fields).buffer));
          agents.forEach((agent, i) => {
            if (!traversal.images || !watched.has(`picture:${topic}:${i}`)) return;
            this.send(`picture:${topic}:${i}`, { hash: traversal.hash, frame: agent.position, type: 'image/svg+xml' }, view(traversal.name, agent.position));
          });
        }
        if (ticks % 3 === 0) this.sendServices();
        const run = this.world.running;
        if (run && ticks % 4 === 0) {
          run.update();
          this.sendTraining(run);
          if (ticks % 8 === 0) this.sendJson('runs', this.runs());
        }
      }, 100),
    );
  }

  private sendServices(): void {
    this.sendJson('services', this.services());
  }

  private services(): Services {
    return { now: Date.now() / 1000, services: this.world.services };
  }

  private sendJson(topic: string, value: object): void {
    this.send(topic, {}, this.json(value));
  }

  private sendTraining(run: RunData): void {
    const columns = Object.keys(run.columns);
    const row = Float64Array.from(columns.map((name) => run.columns[name]?.[run.length - 1] ?? NaN));
    this.send(`training:${run.id}`, { columns, rows: 1 }, Buffer.from(row.buffer));
  }

  /** Returns the topics that somebody watches. */
  watched(): string[] {
    return [...new Set([...this.clients].flatMap((client) => [...client.topics.keys()]))];
  }

  private get mark(): string {
    return this.options.mark ?? '';
  }

  private json(value: object): string {
    return JSON.stringify(value, (key, one: unknown) => {
      if (typeof one === 'string') return OWN.includes(key) || one === CONTROL ? one : this.mark + one;
      // Names of options too, but for those that the page reads.
      if (key === 'parameters') return Object.fromEntries(Object.entries(one as object).map(([name, inner]) => [this.mark + name, inner as unknown]));
      return one;
    });
  }

  private unmarked(text: string): string {
    return this.mark ? text.replaceAll(this.mark, '') : text;
  }

  private send(topic: string, header: object, payload: Buffer | string): void {
    for (const client of this.clients) {
      const name = client.topics.get(topic);
      if (name === undefined) continue;
      let text = JSON.stringify({ topic: name, sequence: ++client.sequence, dropped: 0, ...header });
      text += ' '.repeat((8 - ((4 + Buffer.byteLength(text)) % 8)) % 8);
      const head = Buffer.alloc(4);
      head.writeUInt32LE(Buffer.byteLength(text));
      client.socket.send(Buffer.concat([head, Buffer.from(text), Buffer.from(payload)]));
    }
  }

  private join(socket: WebSocket): void {
    const client: Client = { socket, topics: new Map(), sequence: 0 };
    this.clients.add(client);
    socket.on('close', () => this.clients.delete(client));
    socket.on('message', (data) => {
      const { watch } = JSON.parse((data as Buffer).toString()) as { watch: string[] };
      client.topics = new Map(watch.map((topic) => [this.unmarked(topic), topic]));
    });
  }

  private knows(request: IncomingMessage): boolean {
    const { token } = this.options;
    if (!token) return true;
    return request.headers.authorization === `Bearer ${token}` || (request.headers.cookie ?? '').includes(`session=${this.cookie}`);
  }

  private serve(request: IncomingMessage, response: ServerResponse): void {
    const url = new URL(request.url ?? '/', 'http://mock');
    this.asked.push(`${request.method} ${request.url}`);
    response.setHeader('Content-Security-Policy', CSP);
    response.setHeader('X-Content-Type-Options', 'nosniff');
    response.setHeader('Referrer-Policy', 'no-referrer');
    const fail = (status: number, error: string): void => {
      response.writeHead(status, { 'Content-Type': 'application/json' }).end(this.json({ error }));
    };
    try {
      if (url.pathname === '/healthz') response.writeHead(200, { 'Content-Type': 'text/plain' }).end('ok\n');
      else if (url.pathname === '/login') {
        if (!this.knows(request)) return fail(401, "this needs 'Authorization: Bearer TOKEN'");
        response.writeHead(204, { 'Set-Cookie': `session=${this.cookie}; HttpOnly; SameSite=Strict; Path=/` }).end();
      } else if (url.pathname.startsWith('/api/')) {
        if (!this.knows(request)) return fail(401, 'this needs the token');
        const path = url.pathname.slice(5).split('/').map((part) => this.unmarked(decodeURIComponent(part)));
        const query = new URLSearchParams([...url.searchParams].map(([name, value]) => [name, this.unmarked(value)]));
        const reply = this.api(request.method ?? 'GET', path, query);
        response.writeHead(reply.body === '' ? 204 : 200, { 'Content-Type': reply.type, 'Cache-Control': reply.cache ?? 'no-store' }).end(reply.body);
      } else this.file(url.pathname, response);
    } catch (error) {
      if (error instanceof HttpError) return fail(error.status, error.message);
      fail(500, String(error));
    }
    return undefined;
  }

  private file(path: string, response: ServerResponse): void {
    const name = normalize(path === '/' ? '/index.html' : path);
    const file = join(this.options.page, name);
    if (name.includes('..') || !existsSync(file)) throw new HttpError(404, `there is nothing at ${path}`);
    response.writeHead(200, { 'Content-Type': TYPES[extname(file)] ?? 'application/octet-stream' }).end(readFileSync(file));
  }

  private runs(): { runs: Run[] } {
    return { runs: this.world.runs.map((run) => run.summary()).sort((a, b) => (b.started ?? 0) - (a.started ?? 0)) };
  }

  private api(method: string, path: string[], query: URLSearchParams): Reply {
    const json = (value: object): Reply => ({ type: 'application/json', body: this.json(value) });
    const { world } = this;
    const [head, id, what] = path;
    const known = PARAMETERS[head === 'runs' ? (what ?? '') : what === 'matrix' ? what : (head ?? '')] ?? [];
    for (const name of query.keys()) if (!known.includes(name)) throw new HttpError(400, `parameter '${name}' is not known here`);
    if (query.has('before') && query.get('order') === 'worst') throw new HttpError(400, "parameter 'before' goes with order=newest only");
    switch (head) {
      case 'about':
        return json({
          version: '0.2.0',
          vendor: 'Eclipse Cyclone DDS',
          session: 'all',
          domain: 42,
          store: { file: 'runs/dashboard.sqlite', bytes: 7_340_032, episodes: world.runs.reduce((sum, run) => sum + (run.last('episodes') ?? 0), 0) },
          recording: false,
        });
      case 'services':
        return json(this.services());
      case 'events':
        return json({ events: world.events.slice(0, Number(query.get('limit') ?? 200)) });
      case 'controls':
        return json(CONTROLS);
      case 'map':
        return json(found(world.traversals, (one) => one.hash === id, `no traversal has the hash ${id}`).map);
      case 'frames': {
        const traversal = found(world.traversals, (one) => one.hash === id && one.images, 'this traversal has no pictures');
        return { type: 'image/svg+xml', body: view(traversal.name, Number(what)), cache: 'public, max-age=31536000, immutable' };
      }
      case 'recognition': {
        const { results, curves } = recognition();
        if (world.runs.length === 0) return json({ results: [] });
        if (id === undefined) return json({ results });
        if (what === 'curve') return json({ curves });
        return { type: 'image/svg+xml', body: matrix(40) };
      }
      case 'episodes':
        return json(found(world.runs.flatMap((run) => run.episodes()), (one) => one.rowid === Number(id), `episode ${id} not found`));
      case 'compare': {
        const ids = (query.get('runs') ?? '').split('\n');
        return json(compared(ids.map((one) => found(world.runs, (run) => run.id === one, `run '${one}' not found`).manifest())));
      }
      case 'runs':
        break;
      default:
        throw new HttpError(404, `there is nothing at /api/${path.join('/')}`);
    }
    if (id === undefined) return json(this.runs());
    const run = found(world.runs, (one) => one.id === id, `run '${id}' not found`);
    if (method === 'DELETE') {
      world.runs.splice(world.runs.indexOf(run), 1);
      this.sendJson('runs', this.runs());
      return { type: 'text/plain', body: '' };
    }
    switch (what) {
      case undefined:
        return json({ ...run.summary(), manifest: run.manifest(), traversals: run.traversals() });
      case 'training':
        return json(this.training(run, query));
      case 'evaluations':
        return json({ evaluations: run.evaluations() });
      case 'episodes': {
        let list = run.episodes().map(({ positions: _, hash: __, ...rest }) => rest);
        const is = (name: string, test: (one: (typeof list)[number], value: string) => boolean): void => {
          const value = query.get(name);
          if (value !== null) list = list.filter((one) => test(one, value));
        };
        for (const name of ['evaluation', 'completed', 'shuffled'] as const) is(name, (one, value) => one[name] === (value === '1'));
        for (const name of ['traversal', 'policy', 'update'] as const) is(name, (one, value) => String(one[name]) === value);
        const trained = run.episodes().filter((one) => !one.evaluation);
        is('until', (one, value) => one.rowid <= (trained[Math.min(Number(value), trained.length) - 1]?.rowid ?? 0));
        const total = list.length;
        is('before', (one, value) => one.rowid < Number(value));
        list.sort((a, b) => (query.get('order') === 'worst' ? a.spl - b.spl || b.steps - a.steps || a.rowid - b.rowid : b.rowid - a.rowid));
        return json({ episodes: list.slice(0, Number(query.get('limit') ?? 100)), total });
      }
      default:
        throw new HttpError(404, `a run has no ${what}`);
    }
  }

  private training(run: RunData, query: URLSearchParams): object {
    const points = Number(query.get('points') ?? 2000);
    const names = (query.get('columns') ?? 'reward,spl').split(',');
    const x = query.get('x') ?? 'updates';
    const pick = (name: string): number[] => run.columns[name] ?? [];
    const along = pick(ORDERS[x] ?? 'update');
    const [from, to] = [Number(query.get('from') ?? -Infinity), Number(query.get('to') ?? Infinity)];
    const all = along.flatMap((value, row) => (value >= from && value <= to ? [row] : []));
    const stride = Math.ceil(all.length / points);
    const rows = all.filter((_, i) => i % stride === 0 || i === all.length - 1);
    const column = (name: string): (number | null)[] => rows.map((row) => pick(name)[row] ?? null).map((value) => (Number.isNaN(value) ? null : value));
    const columns = { x: rows.map((row) => along[row]), ...Object.fromEntries(names.map((name) => [name, column(name)])) };
    return { id: run.id, x, total: all.length, decimated: stride > 1, columns };
  }
}
