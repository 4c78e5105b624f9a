// SPDX-License-Identifier: Apache-2.0
import { Mock } from './server';

// npm run mock -- [port] [--token TOKEN] [--empty]: a dashboard without services, for work on the page.
const args = process.argv.slice(2).filter((arg) => arg !== '--');
const token = args.includes('--token') ? args[args.indexOf('--token') + 1] : undefined;
const mock = await Mock.start({
  port: Number(args.find((arg) => /^\d+$/.test(arg)) ?? 8080),
  page: process.env.CITYLEARN_PAGE ?? 'dist',
  empty: args.includes('--empty'),
  ...(token ? { token } : {}),
});
console.log(`mock: ${mock.url}`);

// One service is lost for ten seconds of each minute.
let second = 0;
setInterval(() => {
  second = (second + 1) % 60;
  if (second === 20) mock.lose('env-fall');
  if (second === 30) mock.bring('env-fall');
}, 1000);
