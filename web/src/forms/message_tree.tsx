/** A message as a tree that can be unfolded. Every text is escaped by construction, and long ones are cut. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { t } from "../i18n/text";
import { type Change, selectedFields } from "../robot/fields";

const MOST_TEXT = 300;
const MOST_ITEMS = 50;
/** Fields of one message: no type has as many, but a robot may say what it likes. */
const MOST_FIELDS = 500;
/** Items of a list that is unfolded from the start. */
const MOST_UNFOLDED = 20;
const MOST_COLUMNS = 12;

/** Return true if a value has parts of its own. */
function isCompound(value: unknown): value is object {
  return value !== null && typeof value === "object";
}

/** A plain value as a short text. */
export function shortValue(value: unknown): string {
  // rosbridge has no other way to write these numbers in JSON.
  if (value === null) return t("topics.not_finite");
  if (typeof value === "string") {
    const rest = value.length - MOST_TEXT;
    return rest > 0
      ? `${JSON.stringify(value.slice(0, MOST_TEXT))} ${t("topics.longer", { count: rest })}`
      : JSON.stringify(value);
  }
  if (typeof value === "number" && !Number.isInteger(value)) return String(Number(value.toPrecision(7)));
  return String(value);
}

function summary(value: object): string {
  if (ArrayBuffer.isView(value)) return `[${(value as Uint8Array).length}]`;
  return Array.isArray(value) ? `[${value.length}]` : "";
}

/** The first parts of a value, and the number of all others. */
export function parts(value: object): { shown: [string, unknown][]; hidden: number } {
  if (ArrayBuffer.isView(value) || Array.isArray(value)) {
    const items = value as unknown as ArrayLike<unknown>;
    const count = Math.min(items.length, MOST_ITEMS);
    const shown = Array.from({ length: count }, (_, at): [string, unknown] => [String(at), items[at]]);
    return { shown, hidden: items.length - count };
  }
  // What the worker has added is no part of the message.
  const fields = Object.entries(value).filter(([name]) => !name.startsWith("$"));
  return { shown: fields.slice(0, MOST_FIELDS), hidden: Math.max(0, fields.length - MOST_FIELDS) };
}

function Parts({ value, depth }: { value: object; depth: number }) {
  const { shown, hidden } = parts(value);
  return (
    <>
      {shown.map(([name, part]) => (
        <Branch key={name} name={name} value={part} depth={depth} />
      ))}
      {hidden > 0 && <li class="faint">{t("topics.longer", { count: hidden })}</li>}
    </>
  );
}

export function MessageTree({ value }: { value: unknown }) {
  return (
    <ul class="tree">
      {isCompound(value) ? <Parts value={value} depth={0} /> : <li>{shortValue(value)}</li>}
    </ul>
  );
}

/** True for what is shown unfolded: messages, and short lists of plain values. */
function isShort(value: unknown): boolean {
  if (ArrayBuffer.isView(value)) return (value as Uint8Array).length <= MOST_UNFOLDED;
  return !Array.isArray(value) || (value.length <= MOST_UNFOLDED && !value.some(isCompound));
}

/** The plain values of each message of a list that have the same few fields; null for other values. */
function rowsOf(value: object): Change[][] | null {
  if (!Array.isArray(value) || !value.every(isCompound)) return null;
  const rows = value.slice(0, MOST_ITEMS).map((item) => selectedFields(item, ""));
  const names = new Set(rows.map((row) => row.map(({ path }) => path).join()));
  const count = rows[0]?.length ?? 0;
  return names.size === 1 && count > 0 && count <= MOST_COLUMNS ? rows : null;
}

function Rows({ rows }: { rows: Change[][] }) {
  return (
    <table>
      <thead>
        <tr>
          {rows[0]?.map(({ path }) => (
            <th key={path}>{path}</th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map((row, at) => (
          <tr key={String(at)}>
            {row.map(({ path, value }) => (
              <td key={path}>{shortValue(value)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Branch({ name, value, depth }: { name: string; value: unknown; depth: number }) {
  const open = useSignal(depth < 2 && isShort(value));
  const was = useRef(value);
  useEffect(() => {
    was.current = value;
  }, [value]);
  if (!isCompound(value)) {
    return (
      <li>
        {/* A new element for a new value: its style shows the change. */}
        <span class="tree-name">{name}</span>{" "}
        <code key={shortValue(value)} class={was.current === value ? "" : "changed"}>
          {shortValue(value)}
        </code>
      </li>
    );
  }
  const rows = open.value ? rowsOf(value) : null;
  const hiddenRows = rows ? (value as unknown[]).length - rows.length : 0;
  return (
    <li>
      <button
        type="button"
        class="tree-fold"
        aria-expanded={open.value}
        onClick={() => {
          open.value = !open.value;
        }}
      >
        {name} <span class="faint">{summary(value)}</span>
      </button>
      {rows && <Rows rows={rows} />}
      {open.value && (
        <ul>
          {!rows && <Parts value={value} depth={depth + 1} />}
          {hiddenRows > 0 && <li class="faint">{t("topics.longer", { count: hiddenRows })}</li>}
        </ul>
      )}
    </li>
  );
}
