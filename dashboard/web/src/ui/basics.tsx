// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren, JSX } from 'preact';
import { useErrorBoundary } from 'preact/hooks';
import { failure, type Resource } from '../state/resource';

export function classes(...names: (string | false | null | undefined)[]): string {
  return names.filter(Boolean).join(' ');
}

interface CardProps {
  title: string;
  hint?: string | undefined;
  actions?: ComponentChildren;
  children: ComponentChildren;
  class?: string;
  id?: string | undefined;
}

/** A titled surface. */
export function Card({ title, hint, actions, children, class: name, id }: CardProps): JSX.Element {
  return (
    <section class={classes('card', name)} aria-label={title} id={id}>
      <header class="card-head">
        <div>
          <h2>{title}</h2>
          {hint && <p class="hint">{hint}</p>}
        </div>
        {actions && <div class="row actions">{actions}</div>}
      </header>
      {children}
    </section>
  );
}

/** Explains why there is nothing to show, and what to do. */
export function Empty({ title, children }: { title: string; children?: ComponentChildren }): JSX.Element {
  return (
    <div class="empty">
      <svg viewBox="0 0 64 32" aria-hidden="true">
        <path d="M4 26c14 0 8-16 22-16s10 12 20 12 6-12 14-12" />
        <circle cx="4" cy="26" r="3" />
        <circle cx="60" cy="10" r="3" />
      </svg>
      <b>{title}</b>
      {children && <div>{children}</div>}
    </div>
  );
}

export function Failed({ error }: { error: string }): JSX.Element {
  return (
    <div class="row failed" role="alert">
      <Icon name="alert" />
      <span>{error}</span>
    </div>
  );
}

/** Shows its children, or that what they were given cannot be shown: the rest of the page goes on. */
export function Guard({ children }: { children: ComponentChildren }): JSX.Element {
  const [error] = useErrorBoundary((cause: unknown) => console.error(cause)) as [unknown, () => void];
  return error ? <Failed error={`This cannot be shown, as it is not what the page expects: ${failure(error).error}`} /> : <>{children}</>;
}

export function Loading({ lines = 3 }: { lines?: number }): JSX.Element {
  return (
    <div class="loading" role="status">
      <span class="visually-hidden">Loading</span>
      {Array.from({ length: lines }, (_, i) => (
        <span class="bone" key={i} aria-hidden="true" />
      ))}
    </div>
  );
}

/** Shows a resource, or that it is loading, or the error. */
export function Show<T>({ of, children, lines }: {
  of: Resource<T>;
  children: (value: T) => ComponentChildren;
  lines?: number;
}): JSX.Element {
  if (of.state === 'loading') return <Loading lines={lines ?? 3} />;
  if (of.state === 'failed') return <Failed error={of.error} />;
  return <>{children(of.value)}</>;
}

export interface Option<T extends string> {
  value: T;
  label: string;
}

interface SelectProps<T extends string> {
  label: string;
  value: T;
  options: readonly Option<T>[];
  onChange: (value: T) => void;
  /** The label is for screen readers only. */
  quiet?: boolean;
}

export function Select<T extends string>({ label, value, options, onChange, quiet }: SelectProps<T>): JSX.Element {
  return (
    <label class="field hint">
      <span class={classes(quiet && 'visually-hidden')}>{label}</span>
      <select value={value} onChange={(event) => onChange(event.currentTarget.value as T)}>
        {options.map((option) => (
          <option key={option.value} value={option.value}>
            {option.label}
          </option>
        ))}
      </select>
    </label>
  );
}

interface TickProps {
  type?: 'checkbox' | 'radio';
  checked: boolean;
  disabled?: boolean;
  onChange: () => void;
  label?: string;
  children: ComponentChildren;
}

/** A checkbox or a radio button before what it chooses. */
export function Tick({ type = 'checkbox', label, children, ...rest }: TickProps): JSX.Element {
  return (
    <label class="row">
      <input type={type} aria-label={label} {...rest} />
      {children}
    </label>
  );
}

const ICONS = {
  overview: 'M4 5h7v6H4zM13 5h7v4h-7zM13 11h7v8h-7zM4 13h7v6H4z',
  training: 'M4 19V5M4 19h16M7 15c3 0 3-7 6-7s3 3 7-2',
  route: 'M6 19c5 0 1-7 6-7s2-7 6-7M6 19h.01M18 5h.01',
  deployment: 'M5 21V4h11l-2 4 2 4H5',
  compare: 'M8 4v16M16 4v16M4 8h4M16 8h4M4 14h4M16 14h4',
  alert: 'M12 4 2.5 20h19zM12 10v4M12 17h.01',
  save: 'M12 4v10M8 10l4 4 4-4M5 19h14',
  play: 'M8 5l11 7-11 7z',
  pause: 'M8 5v14M16 5v14',
  plus: 'M12 5v14M5 12h14',
  minus: 'M5 12h14',
  home: 'M4 12l8-7 8 7M6 11v8h12v-8',
  trash: 'M5 7h14M9 7V4h6v3M7 7l1 13h8l1-13',
} as const;
export type IconName = keyof typeof ICONS;

export function Icon({ name }: { name: IconName }): JSX.Element {
  return (
    <svg class="icon" viewBox="0 0 24 24" aria-hidden="true">
      <path d={ICONS[name]} />
    </svg>
  );
}

export function IconButton({ icon, label, onClick, disabled }: {
  icon: IconName;
  label: string;
  disabled?: boolean;
  onClick: () => void;
}): JSX.Element {
  return (
    <button
      type="button"
      class="icon-button"
      title={label}
      aria-label={label}
      disabled={disabled}
      onClick={onClick}
    >
      <Icon name={icon} />
    </button>
  );
}

const TONES = {
  good: ['running', 'back', 'started', 'reached'],
  warn: ['restarted'],
  bad: ['lost', 'failed', 'alarm', 'missed'],
};

/**
 * Returns the class of the colour of a state or an event; none for what calls for no attention: a service that starts, waits
 * for work or stops is as healthy as one that runs.
 */
export function toneOf(word: string): string | undefined {
  return Object.entries(TONES).flatMap(([tone, words]) => (words.includes(word) ? [`tone-${tone}`] : []))[0];
}

/** A state as a word, a shape and a colour. */
export function State({ state }: { state: string }): JSX.Element {
  return <span class={classes('hint state', `state-${state}`, toneOf(state))}>{state}</span>;
}

/** A sample of a line's colour. */
export function Swatch({ colour }: { colour: string }): JSX.Element {
  return (
    <svg class="swatch" viewBox="0 0 18 8" aria-hidden="true">
      <line x1="0" x2="18" y1="4" y2="4" style={{ stroke: `var(--${colour})` }} />
    </svg>
  );
}
