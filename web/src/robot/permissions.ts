/** Permissions of this client, as reported by the server. */

export type Act = "publish" | "subscribe" | "call" | "provide" | "goals" | "get_param" | "set_param";

/** Milliseconds to wait for the answer. */
const PATIENCE = 60_000;

/** The answer of a server's `/role`. */
export interface RoleAnswer {
  role: string;
  unrestricted: boolean;
  allows: Partial<Record<Act, string[]>>;
  /** Features of the server beside rosbridge; older ones do not report them. */
  features?: string[];
}

/** Features beside rosbridge: data channels, video out, video and sound in, files of recordings. */
export type Feature = "webrtc" | "whep" | "whip" | "recordings";

/** Return true if a glob of fnmatch, in which `*` also matches `/`, fits a name. */
export function globFits(glob: string, name: string): boolean {
  let pattern = "";
  for (let at = 0; at < glob.length; at++) {
    const char = glob[at] as string;
    if (char === "*") pattern += ".*";
    else if (char === "?") pattern += ".";
    else if (char === "[" && glob.indexOf("]", at + 2) > 0) {
      const end = glob.indexOf("]", at + 2);
      const set = glob.slice(at + 1, end).replace(/\\/g, "\\\\");
      pattern += `[${set.startsWith("!") ? `^${set.slice(1)}` : set.startsWith("^") ? `\\${set}` : set}]`;
      at = end;
    } else pattern += char.replace(/[\\^$.|+()[\]{}]/g, "\\$&");
  }
  return new RegExp(`^${pattern}$`, "s").test(name);
}

/** The acts that a role allows. A server that says nothing is asked by trying. */
export class Permissions {
  constructor(private readonly answer: RoleAnswer | null) {}

  /** The name of the role; empty where the server names none. */
  get role(): string {
    return this.answer?.role ?? "";
  }

  /** Return true if the server says that it has something. */
  has(feature: Feature): boolean {
    return this.answer?.features?.includes(feature) ?? false;
  }

  /** Return true if an act with an absolute name is allowed, or at least not known to be refused. */
  may(act: Act, name: string): boolean {
    if (this.answer === null || this.answer.unrestricted) return true;
    return (this.answer.allows[act] ?? []).some((glob) => globFits(glob, name));
  }
}

/** Ask the server that is reached over HTTP at `base` what the bearer of a token may do. */
export async function askPermissions(base: string, token: string): Promise<Permissions> {
  try {
    const headers: Record<string, string> = token ? { Authorization: `Bearer ${token}` } : {};
    const response = await fetch(new URL("role", base), { headers, signal: AbortSignal.timeout(PATIENCE) });
    if (!response.ok) return new Permissions(null);
    const answer = (await response.json()) as RoleAnswer;
    return typeof answer?.role === "string" ? new Permissions(answer) : new Permissions(null);
  } catch (error) {
    // Another kind of rosbridge server, or one whose HTTP cannot be reached from this page.
    console.debug("not asked for permissions:", error);
    return new Permissions(null);
  }
}
