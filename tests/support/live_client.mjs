// What programs share that speak to a live arm as its page does.

/** @param WebSocket of the package `ws` @param address  that the program prints, with its token */
export function openLive(WebSocket, address) {
  const { host, hash } = new URL(address);
  const token = hash.slice(1);
  return new WebSocket(`wss://${host}/live`, ['viable.1', token], {
    origin: `https://${host}`,
    rejectUnauthorized: false,
    finishRequest: (request) => {
      request.setHeader('Sec-WebSocket-Protocol', `viable.1, ${token}`); // with a blank, as browsers write it
      request.end();
    },
  });
}

export const quantile = (numbers, share) => Float64Array.from(numbers).sort()[Math.floor(share * (numbers.length - 1))];
