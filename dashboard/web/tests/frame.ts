// SPDX-License-Identifier: Apache-2.0
/** Returns a frame of the WebSocket as the server makes it, with `slack` more bytes of header than there should be. */
export function frameOf(header: object | string, payload: Uint8Array, slack = 0): Buffer {
  const text = Buffer.from(typeof header === 'string' ? header : JSON.stringify(header));
  const padded = Buffer.concat([text, Buffer.alloc(7 - ((text.length + 3) % 8) + slack, ' ')]);
  const length = Buffer.alloc(4);
  length.writeUInt32LE(padded.length);
  return Buffer.concat([length, padded, payload]);
}
