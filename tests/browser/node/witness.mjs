// What a page did, for whoever asks why a test failed: its console, its requests, its sockets and its workers.

const MOST = 40; // Lines of each kind, the last ones.
const HURRY = 3000; // Milliseconds for the page to say what it shows: it may hang.

/** Watches a page of Playwright's or Puppeteer's from now on; returns what tells of it, as lines of text. */
export function witness(page) {
  const began = Date.now();
  const since = () => `${((Date.now() - began) / 1000).toFixed(1)} s`;
  const said = [];
  const failed = [];
  const pending = new Map();
  const sockets = [];
  const workers = new Map();
  const keep = (lines, line) => {
    lines.push(line);
    if (lines.length > MOST) lines.shift();
  };
  page.on('console', (message) => keep(said, `${since()} ${message.type()}: ${message.text().slice(0, 500)}`));
  page.on('pageerror', (error) => keep(said, `${since()} exception: ${error.stack ?? error}`));
  page.on('crash', () => keep(said, `${since()} the page crashed`));
  page.on('request', (request) => pending.set(request, since()));
  page.on('requestfinished', (request) => pending.delete(request));
  page.on('requestfailed', (request) => {
    keep(failed, `${request.method()} ${request.url()}, begun at ${pending.get(request)}: ${request.failure()?.errorText}`);
    pending.delete(request);
  });
  // Playwright alone tells of sockets.
  page.on('websocket', (socket) => {
    const seen = { url: socket.url(), begun: since(), received: 0, last: '-', end: '' };
    keep(sockets, seen);
    socket.on('framereceived', () => {
      seen.received++;
      seen.last = since();
    });
    socket.on('socketerror', (error) => {
      seen.end += ` failed at ${since()}: ${error}`;
    });
    socket.on('close', () => {
      seen.end += ` closed at ${since()}`;
    });
  });
  const note = (worker) => workers.set(worker, since());
  page.on('worker', (worker) => {
    note(worker);
    worker.on('close', () => workers.delete(worker));
  });
  page.on('workercreated', note);
  page.on('workerdestroyed', (worker) => workers.delete(worker));
  const part = (title, lines) => [`  ${title}:${lines.length ? '' : ' none'}`, ...lines.map((line) => `    ${line}`)];
  return async () => {
    const late = new Promise((tell) => setTimeout(tell, HURRY, 'it does not say within 3 s'));
    const shown = page
      .evaluate(`[document.body.innerText, ...[...document.querySelectorAll('input, select')].map((it) => '[' + it.value + ']')].join(' ')`)
      .then((text) => String(text).replace(/\s+/g, ' ').slice(0, 1500))
      .catch((error) => `it does not say: ${error.message}`);
    return [
      `${page.url?.() ?? 'the page'}, ${since()} after it was opened`,
      ...part('it shows', [await Promise.race([shown, late])]),
      ...part('console', said),
      ...part('requests that failed', failed),
      ...part('requests without an end', [...pending].map(([it, at]) => `${it.method()} ${it.url()}, begun at ${at}`)),
      ...part('sockets', sockets.map((it) => `${it.url}, begun at ${it.begun}; ${it.received} messages, last ${it.last};${it.end || ' open'}`)),
      ...part('workers', [...workers].map(([it, at]) => `${it.url()}, begun at ${at}`)),
    ].join('\n');
  };
}
