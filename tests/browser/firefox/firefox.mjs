// Firefox for the tests, as it is released, through WebDriver BiDi.

import puppeteer from 'puppeteer-core';

const PATIENCE = 60000; // Less than the one who asks waits for the answer.

export async function launch(executablePath) {
  const browser = await puppeteer.launch({
    browser: 'firefox',
    executablePath,
    headless: false, // Without a display Firefox has no WebGL: `make firefox` gives it a virtual one.
    protocolTimeout: PATIENCE,
    extraPrefsFirefox: {
      'webgl.force-enabled': true,
      'media.autoplay.default': 0,
      // A camera that shows a test picture, and that nobody is asked for.
      'media.navigator.streams.fake': true,
      'media.navigator.permission.disabled': true,
      'layout.css.devPixelsPerPx': '1.0',
    },
  });
  // Only the page in front is drawn and has the mouse; one that is opened is in front.
  let front;
  const inFront = (page, act) => async (...args) => {
    if (front !== page) await page.bringToFront();
    front = page;
    return act(...args);
  };
  return {
    version: await browser.version(),
    async open(width, height, locale) {
      const context = await browser.createBrowserContext();
      const page = await context.newPage();
      await page.setViewport({ width, height, deviceScaleFactor: 1 });
      // The browser's language is a setting of all of it; a page sees this one.
      await page.evaluateOnNewDocument((languages) => {
        Object.defineProperty(navigator, 'languages', { get: () => languages });
      }, [locale]);
      page.setDefaultTimeout(PATIENCE);
      // A node of the page comes as undefined, and "there is none" would always be true: an expression says true of it.
      const evaluate = page.evaluate.bind(page);
      page.evaluate = (script, ...args) =>
        evaluate(
          typeof script === 'string' && !script.includes(';') ? `((it) => it instanceof Node || it)((${script}\n))` : script,
          ...args,
        );
      front = page;
      page.screenshot = inFront(page, page.screenshot.bind(page));
      page.mouse.move = inFront(page, page.mouse.move.bind(page.mouse));
      page.mouse.dblclick = (x, y) => page.mouse.click(x, y, { count: 2 });
      const press = page.keyboard.press.bind(page.keyboard);
      page.keyboard.press = async (chord) => {
        const held = chord.split('+').slice(0, -1).filter(Boolean); // Of "+" none.
        for (const key of held) await page.keyboard.down(key);
        await press(chord.slice(held.join('+').length + (held.length ? 1 : 0)));
        for (const key of held.reverse()) await page.keyboard.up(key);
      };
      return { page, click: (selector) => click(page, selector), close: () => context.close() };
    },
    close: () => browser.close(),
  };
}

// Clicks the middle of what a selector of Playwright's names, once it is there, shown and not covered.
async function click(page, selector) {
  const steps = selector.split(' >> ').map((step) => {
    const text = /^text=(['"]?)(.*)\1$/s.exec(step);
    if (text) return { text: text[2], exact: text[1] !== '' };
    const both = /^(.*):has-text\((['"])(.*)\2\)$/s.exec(step);
    return both ? { css: both[1], text: both[3], exact: false } : { css: step };
  });
  const late = Date.now() + PATIENCE;
  for (;;) {
    const place = await page.evaluate(placeOf, steps);
    if (place) return void (await page.mouse.click(...place));
    if (Date.now() > late) throw new Error(`there is nothing to click: ${selector}`);
    await new Promise((later) => setTimeout(later, 50));
  }
}

// In the page: where an element is that can be clicked; null where there is none yet.
function placeOf(steps) {
  const within = (root) => {
    const found = [];
    for (const element of root.querySelectorAll('*')) {
      found.push(element);
      if (element.shadowRoot) found.push(...within(element.shadowRoot));
    }
    return found;
  };
  const isShown = (element) => element.checkVisibility({ visibilityProperty: true });
  const plain = (text) => text.trim().replace(/\s+/g, ' '); // As people read it: blanks count once.
  const says = (element, { text, exact }) => {
    const said = plain(element.innerText ?? '');
    return exact ? said === plain(text) : said.toLowerCase().includes(plain(text).toLowerCase());
  };
  let roots = [document];
  for (const step of steps) {
    const inside = roots.flatMap((root) => [
      ...within(root),
      ...(root.shadowRoot ? within(root.shadowRoot) : []),
      ...(root instanceof Element ? [root] : []),
    ]);
    const fitting = inside.filter(
      (element) => (!step.css || element.matches(step.css)) && (step.text === undefined || says(element, step)),
    );
    // Of elements that hold each other with the same text, the innermost is meant.
    roots = step.css ? fitting : fitting.filter((one) => !fitting.some((other) => other !== one && one.contains(other)));
  }
  const element = roots.find((one) => isShown(one) && !one.disabled);
  if (!element) return null;
  element.scrollIntoView({ block: 'center', inline: 'center' }); // Not below a heading that stays.
  const { left, top, width, height } = element.getBoundingClientRect();
  return width && height ? [left + width / 2, top + height / 2] : null;
}
