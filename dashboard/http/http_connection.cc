// SPDX-License-Identifier: Apache-2.0
#include <poll.h>
#include <spdlog/fmt/chrono.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/span_body.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket.hpp>
#include <ctime>

#include "core/util/text.h"
#include "dashboard/http/request_handler.h"
#include "dashboard/http/server_context.h"
#include "dashboard/http/transport.h"

namespace citylearn {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;
using Time = Connection::Time;

constexpr int kSendBuffer = 256 << 10;  // what waits in the kernel is old when a slow client gets it
constexpr std::size_t kLingerBytes = 1 << 20;
constexpr std::chrono::milliseconds kLingerTimeout{2000};

Time now() { return Time::clock::now(); }

auto with(error_code& error) { return asio::redirect_error(asio::use_awaitable, error); }

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

using Request = http::request<http::string_body>;

std::string http_date() { return fmt::format("{:%a, %d %b %Y %H:%M:%S GMT}", fmt::gmtime(std::time(nullptr))); }

using Response = http::response<http::span_body<const char>>;

/// Forbids browsers to frame or sniff an answer, to let other sites read it, and to fetch anything from elsewhere.
void put_strict_headers(http::fields& fields) {
  fields.set("Content-Security-Policy",
             "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; style-src 'self'; "
             "frame-ancestors 'none'; base-uri 'none'; form-action 'none'");
  fields.set("X-Content-Type-Options", "nosniff");
  fields.set("Referrer-Policy", "no-referrer");
  fields.set("Cross-Origin-Opener-Policy", "same-origin");
  fields.set("Cross-Origin-Resource-Policy", "same-origin");
  fields.set("Cache-Control", "no-store");
}

RequestHead head_of(const Request& request, const asio::ip::address& client) {
  return {view(request.method_string()),
          {view(request[http::field::host]), view(request[http::field::origin]),
           view(request[http::field::authorization]), view(request[http::field::cookie])},
          view(request[http::field::if_none_match]),
          view(request[http::field::accept_encoding]),
          view(request["Sec-Fetch-Site"]),
          client.to_string()};
}

// GCC 12 destroys temporaries in a co_await's arguments twice when they are converted there (bug 99576 and its kin):
// what coroutines take has a name before.
using Call = std::function<Answer()>;

/// Answers an API call on a worker, unless the client has `gone` by then, and continues on the server's thread.
asio::awaitable<Answer> on_worker(ServerContext& context, const Call& call, const std::atomic<bool>& gone) {
  const auto begin = [&context, &call, &gone](auto handler) {
    asio::post(context.workers, [&context, &gone, call, handler = std::move(handler)]() mutable {
      Answer answer;
      try {
        if (!gone) answer = call();
      } catch (const std::exception& error) {
        spdlog::error("an API call failed: {}", error.what());
        answer = error_answer(500, error.what());
      }
      asio::post(context.io,
                 [handler = std::move(handler), answer = std::move(answer)]() mutable { handler(std::move(answer)); });
    });
  };
  Answer answer =
      co_await asio::async_initiate<const asio::use_awaitable_t<>, void(Answer)>(begin, asio::use_awaitable);
  co_return answer;
}

class HttpConnection : public Connection, public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ServerContext& context, Transport stream)
      : context_(context),
        handler_(context),
        stream_(std::move(stream)),
        buffer_(context.options.header_bytes + context.options.body_bytes),
        wake_(context.io) {
    error_code none;
    address = socket().remote_endpoint(none).address();
    deadline = since + context.options.request_time;
    context_.connections.add(*this);
  }
  ~HttpConnection() override { context_.connections.remove(*this); }

  void begin() {
    asio::co_spawn(
        context_.io, [self = shared_from_this()] { return self->run(); }, asio::detached);
  }

  void close() override {
    context_.connections.remove(*this);
    error_code none;
    socket().close(none);
    wake_.cancel();
    ended_ = true;
  }

  void tick(Time at) override {
    if (!live_ && !idle && hung_up()) close();
    if (!live_ || !live_->is_open()) return;
    const auto patience = context_.options.patience;
    if (at - heard_ > patience || at - writing_ > patience) {  // either may be Time::max()
      ++context_.timed_out;
      close();
    } else if (next_ping_ <= at && !pinging_) {
      next_ping_ = at + context_.options.ping;
      pinging_ = true;
      live_->async_ping({}, [self = shared_from_this()](error_code) { self->pinging_ = false; });
    }
  }

 private:
  tcp::socket& socket() { return live_ ? live_->next_layer().socket() : stream_.socket(); }

  /// Returns whether the client has closed its end, also when it has sent more before.
  bool hung_up() {
    pollfd poll{socket().native_handle(), POLLRDHUP, 0};
    return ::poll(&poll, 1, 0) == 1;
  }

  asio::awaitable<void> run() {
    error_code error;
    // Nothing is allocated, and no TLS begun, for clients that connect and send nothing.
    co_await socket().async_wait(tcp::socket::wait_read, with(error));
    if (error) co_return;
    co_await stream_.async_handshake(with(error));
    if (error) co_return;
    bool more = true;
    while (more && !ended_) more = co_await exchange();
  }

  /// Serves one request. Returns false when it was the last.
  asio::awaitable<bool> exchange() {
    wait_for_client();
    http::request_parser<http::string_body> parser;
    parser.header_limit(context_.options.header_bytes);
    const std::size_t most_bytes = context_.options.body_bytes;
    parser.body_limit(most_bytes);
    error_code error;
    co_await http::async_read_header(stream_, buffer_, parser, with(error));
    if (!error && parser.content_length().value_or(0) > most_bytes) error = http::error::body_limit;
    const auto target = error ? std::nullopt : parse_target(view(parser.get().target()));
    if (!error && parser.get().count(http::field::host) > 1) {
      const Reply reply = error_reply(400, "the header has more than one Host");
      co_return co_await send(reply, parser.get(), false);
    }
    if (!error) {
      const std::optional<Reply> refusal = handler_.refusal(head_of(parser.get(), address), target);
      if (refusal) co_return co_await send(*refusal, parser.get(), parser.is_done() && parser.get().keep_alive());
      if (!parser.is_done()) co_await http::async_read(stream_, buffer_, parser, with(error));
    }
    if (error) {
      const std::optional<Reply> answer = error_of(error);
      if (answer) co_await send(*answer, parser.get(), false);
      co_return false;
    }
    Request request = parser.release();
    idle = false;
    if (target->path == "/api/live") {
      if (websocket::is_upgrade(request)) {
        co_await live(request);
        co_return false;
      }
      const Reply reply = error_reply(400, "this address expects a WebSocket");
      co_return co_await send(reply, request, request.keep_alive());
    }
    Reply reply;
    if (target->segments[0] == "api")
      reply = co_await api(request, *target);
    else if (target->path == "/metrics")
      reply = co_await metrics();
    else
      reply = handler_.reply(head_of(request, address), *target);
    if (ended_) co_return false;
    co_return co_await send(reply, request, request.keep_alive());
  }

  /// Returns nothing for a connection that just ended.
  std::optional<Reply> error_of(const error_code& error) const {
    const ServerOptions& options = context_.options;
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return error_reply(431, "the header is larger than " + std::to_string(options.header_bytes) + " bytes");
    if (error == http::error::body_limit)
      return error_reply(413, "the body is larger than " + std::to_string(options.body_bytes) + " bytes");
    if (error == http::error::end_of_stream || error == http::error::partial_message) return std::nullopt;
    if (error.category() != http::make_error_code(http::error::bad_method).category()) return std::nullopt;
    return error_reply(400, "this is not HTTP: " + error.message());
  }

  asio::awaitable<Reply> api(Request& request, const Target& target) {
    const auto shared = std::make_shared<Query>();  // a Call is copied
    Query& query = *shared;
    if (request.method() == http::verb::delete_) query.method = "DELETE";
    query.path.assign(target.segments.begin() + 1, target.segments.end());
    query.parameters = target.parameters;
    const Call call = [this, shared] { return context_.handlers.api(*shared); };
    co_return co_await call_api(call);
  }

  asio::awaitable<Reply> metrics() {
    Answer answer;
    answer.type = "text/plain; version=0.0.4; charset=utf-8";
    answer.body = handler_.metrics();
    if (!context_.handlers.metrics) co_return Reply{answer, {}};
    const Call call = [this, answer]() mutable {
      answer.body += context_.handlers.metrics();
      return answer;
    };
    co_return co_await call_api(call);
  }

  asio::awaitable<Reply> call_api(const Call& call) {
    if (context_.calls >= context_.options.waiting) {
      Reply reply = error_reply(503, "too many requests wait already");
      reply.answer.headers.emplace_back("Retry-After", "1");
      co_return reply;
    }
    ++context_.calls;
    deadline = Time::max();  // the client waits for us now
    Answer answer = co_await on_worker(context_, call, ended_);
    --context_.calls;
    co_return Reply{std::move(answer), {}};
  }

  /// Returns true when the connection stays open.
  asio::awaitable<bool> send(const Reply& reply, const Request& request, bool keep) {
    const Answer& answer = reply.answer;
    const std::string_view body = reply.file.empty() ? std::string_view(answer.body) : reply.file;
    const bool bodiless = answer.status == 204 || answer.status == 304, head = request.method() == http::verb::head;
    ++context_.answers[answer.status];
    Response response;
    response.version(request.version() == 10 ? 10 : 11);
    response.result(static_cast<unsigned>(answer.status));
    put_strict_headers(response);
    response.set(http::field::date, http_date());
    for (const auto& [name, value] : answer.headers)
      response.set(name, one_line(value));  // no value can begin another header
    if (!bodiless) {
      response.set(http::field::content_type, answer.type);
      response.content_length(body.size());
      if (!head) response.body() = beast::span<const char>(body.data(), body.size());
    }
    response.keep_alive(keep);
    http::response_serializer<http::span_body<const char>> serializer(response);
    error_code error;
    while (!error && !serializer.is_done()) {
      wait_for_client();
      co_await http::async_write_some(stream_, serializer, with(error));
    }
    if (!error && !keep) co_await linger();
    co_return !error && keep;
  }

  /// Sets the deadline by which the client has to take what is sent next.
  void wait_for_client() {
    idle = true;
    since = now();
    deadline = since + context_.options.request_time;
  }

  /// Takes what the client still sends for a moment: a connection closed before is reset, and the last answer is lost.
  asio::awaitable<void> linger() {
    error_code error;
    socket().shutdown(tcp::socket::shutdown_send, error);
    idle = true;
    since = now();
    deadline = since + std::min<std::chrono::milliseconds>(context_.options.request_time, kLingerTimeout);
    std::string discarded(16 << 10, '\0');
    for (std::size_t taken = 0; !error && taken < kLingerBytes;) {
      const std::size_t count = co_await socket().async_read_some(asio::buffer(discarded), with(error));
      taken += count;
    }
  }

  asio::awaitable<void> live(const Request& request) {
    error_code error;
    socket().set_option(asio::socket_base::send_buffer_size(kSendBuffer), error);
    deadline = now() + context_.options.request_time;
    live_.emplace(std::move(stream_));
    live_->auto_fragment(false);
    live_->read_message_max(context_.options.message_bytes);
    live_->binary(true);
    live_->set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      put_strict_headers(response);
      response.set(http::field::server, "citylearn");  // else Beast puts its own there
    }));
    live_->control_callback([this](websocket::frame_type kind, beast::string_view) {
      heard_ = now();
      if (kind != websocket::frame_type::close) return;
      deadline = heard_ + kLingerTimeout;  // to take our close frame
      client_->watch({});
    });
    co_await live_->async_accept(request, with(error));
    if (error) co_return;
    ++context_.answers[101];
    deadline = Time::max();
    heard_ = now();
    next_ping_ = heard_ + context_.options.ping;
    client_ = context_.hub.join([&io = context_.io, connection = weak_from_this()] {
      asio::post(io, [connection] {
        if (const auto self = connection.lock()) self->wake_.cancel();
      });
    });
    asio::co_spawn(
        context_.io, [self = shared_from_this()] { return self->write_frames(); }, asio::detached);
    beast::flat_buffer received;
    for (;;) {
      received.clear();
      co_await live_->async_read(received, with(error));
      if (error) break;
      heard_ = now();
      const auto topics = live_->got_text() ? parse_watch(beast::buffers_to_string(received.data()))
                                            : std::optional<std::set<std::string>>();
      if (!topics) {
        ++context_.malformed;
        deadline = now() + kLingerTimeout;
        const websocket::close_reason reason(websocket::close_code::policy_error,
                                             R"(send {"watch": [at most 64 topics]})");
        co_await live_->async_close(reason, with(error));
        break;
      }
      client_->watch(*topics);
    }
    if (error.category() == websocket::make_error_code(websocket::error::closed).category() &&
        error != websocket::error::closed)
      ++context_.malformed;
    close();
  }

  asio::awaitable<void> write_frames() {
    error_code error;
    while (!error && !ended_) {
      const std::optional<ClientHub::Frame> frame = client_->next();
      if (!frame) {
        error_code woken;
        wake_.expires_at(Time::max());
        co_await wake_.async_wait(with(woken));
        continue;
      }
      const std::array<asio::const_buffer, 2> parts = {asio::buffer(frame->head), asio::buffer(*frame->payload)};
      writing_ = now();
      const std::size_t bytes = co_await live_->async_write(parts, with(error));
      context_.frame_bytes += bytes;
      writing_ = Time::max();
    }
    client_->watch({});  // the client is gone
  }

  ServerContext& context_;
  RequestHandler handler_;
  Transport stream_;
  beast::flat_buffer buffer_;
  std::atomic<bool> ended_{false};  // workers read it

  // The WebSocket.
  std::optional<websocket::stream<Transport>> live_;
  std::shared_ptr<ClientHub::Client> client_;
  asio::steady_timer wake_;  // never fires; cancelled when there is something to write
  Time heard_ = Time::max(), writing_ = Time::max(), next_ping_ = Time::max();
  bool pinging_ = false;
};

}  // namespace

void serve(ServerContext& context, tcp::socket socket) {
  std::make_shared<HttpConnection>(context, Transport(std::move(socket), context.tls.get()))->begin();
}

}  // namespace citylearn
