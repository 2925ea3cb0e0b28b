// Chromium for the tests, through Playwright.

import { chromium } from 'playwright-core';

export async function launch(executablePath) {
  const browser = await chromium.launch({
    executablePath,
    args: [
      '--no-sandbox', // Chromium refuses to run as root with it, and containers have no namespaces for it.
      '--use-gl=angle', // WebGL in software: the machines that test have no graphics card.
      '--use-angle=swiftshader',
      '--enable-unsafe-swiftshader',
      '--autoplay-policy=no-user-gesture-required',
      '--disable-dev-shm-usage',
      // A camera that shows a test picture, and that nobody is asked for.
      '--use-fake-device-for-media-stream',
      '--use-fake-ui-for-media-stream',
    ],
  });
  return {
    version: browser.version(),
    async open(width, height, locale) {
      const context = await browser.newContext({ viewport: { width, height }, deviceScaleFactor: 1, locale });
      const page = await context.newPage();
      page.setDefaultTimeout(60000); // Less than the one who asks waits for the answer.
      let inspector;
      return {
        page,
        click: (selector) => page.click(selector),
        async inspect(method, params) {
          inspector ??= await context.newCDPSession(page);
          return inspector.send(method, params);
        },
        async trace(seconds) {
          await browser.startTracing(page, { categories: ['toplevel', 'devtools.timeline', 'disabled-by-default-devtools.timeline'] });
          await new Promise((later) => setTimeout(later, seconds * 1000));
          return browser.stopTracing();
        },
        close: () => context.close(),
      };
    },
    close: () => browser.close(),
  };
}
