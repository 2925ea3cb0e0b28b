/**
 * Names and texts of a robot as plain text: characters that turn the direction of text, hide or control it are written as
 * their codes, so that a name looks like no other one. Importing this applies it to every text and tooltip of components.
 */

import { options, type VNode } from "preact";

/** Those that the command line escapes, too; line breaks and tabs are left. */
const CONTROLS =
  // biome-ignore lint/suspicious/noControlCharactersInRegex: they are what is looked for.
  /[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff]/g;
/** Attributes that are read by people. */
const READ = ["title", "aria-label", "aria-valuetext", "placeholder", "alt", "data-age", "data-time"];

/** A text without characters that control it. */
export function plain(text: string): string {
  return text.replace(CONTROLS, (each) => `\\u${each.charCodeAt(0).toString(16).padStart(4, "0")}`);
}

function plainChildren(children: unknown): unknown {
  if (typeof children === "string") return plain(children);
  return Array.isArray(children) ? children.map(plainChildren) : children;
}

const before = options.vnode;
options.vnode = (node: VNode) => {
  if (typeof node.type === "string") {
    const props = node.props as Record<string, unknown>;
    props.children = plainChildren(props.children);
    for (const name of READ) if (typeof props[name] === "string") props[name] = plain(props[name]);
  }
  before?.(node);
};
