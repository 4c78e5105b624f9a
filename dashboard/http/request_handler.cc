// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/request_handler.h"

#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <ctime>

#include "dashboard/http/target.h"

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
constexpr std::chrono::milliseconds kLingerTime{2000};

Time now() { return Time::clock::now(); }

auto with(error_code& error) { return asio::redirect_error(asio::use_awaitable, error); }

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

using Request = http::request<http::string_body>;

/// An answer on its way out: of the API, a file of the page, or our own words.
struct Reply {
  Answer answer;
  std::string_view file;  // bytes that outlive it, in the place of answer.body
};

Reply words(int status, const std::string& what) { return {error_answer(status, what), {}}; }

/// For people who opened something in a browser. No style: the policy forbids it outside of files.
Reply letter(int status, const std::string& title, const std::string& text) {
  Answer answer;
  answer.status = status;
  answer.type = "text/html; charset=utf-8";
  answer.body = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + title +
                "</title></head>\n<body><h1>" + title + "</h1>\n<p>" + text + "</p></body></html>\n";
  return {answer, {}};
}

std::string http_date() {
  const std::time_t seconds = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[40];
  const std::size_t length = std::strftime(text, sizeof text, "%a, %d %b %Y %H:%M:%S GMT", &parts);
  return {text, length};
}

using Response = http::response<http::span_body<const char>>;

/// No value can begin another header.
std::string one_line(std::string text) {
  for (char& c : text)
    if ((c >= 0 && c < ' ') || c == '\x7F') c = '?';
  return text;
}

/// Nothing of ours may be framed, sniffed, read by other sites, or fetch anything from elsewhere.
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

/// What is said without the API: everything about a request but its bytes.
class Desk {
 public:
  explicit Desk(Premises& premises) : premises_(premises) {}

  static Access::Request credentials(const Request& request) {
    return {view(request[http::field::host]), view(request[http::field::origin]),
            view(request[http::field::authorization]), view(request[http::field::cookie])};
  }

  /// Why the request goes no further. Nothing: it is authorised.
  std::optional<Reply> refusal(const Request& request, const std::optional<Target>& target) {
    const Access::Request who = credentials(request);
    if (const auto why = premises_.access->stranger(who)) return words(403, *why);
    const bool api = target && target->segments[0] == "api";
    const bool known = request.method() == http::verb::get || request.method() == http::verb::head ||
                       (api && request.method() == http::verb::delete_);
    if (!known) {
      Reply reply = words(405, "this is not done with " + std::string(view(request.method_string())));
      reply.answer.headers.emplace_back("Allow", api ? "GET, HEAD, DELETE" : "GET, HEAD");
      return reply;
    }
    if (!target) return words(400, "the path or a parameter of it is not properly percent-encoded UTF-8");
    if ((api || target->path == "/metrics") && !premises_.access->knows(who)) {
      Reply reply = words(401, "this needs the token: 'Authorization: Bearer TOKEN', or the link that was printed");
      reply.answer.headers.emplace_back("WWW-Authenticate", "Bearer");
      return reply;
    }
    return std::nullopt;
  }

  /// Of all that is not the API's.
  Reply reply(const Request& request, const Target& target) {
    if (target.path == "/healthz") {
      Reply reply;
      reply.answer.type = "text/plain; charset=utf-8";
      reply.answer.body = "ok\n";
      return reply;
    }
    if (target.path == "/login") return login(request, target);
    const Page::File* file = premises_.page.find(target.path);
    if (!file && target.path == "/" && premises_.page.empty())
      return letter(404, "The page is not built",
                    "The dashboard runs and answers under /api/, but the page's files are not there. Install Node.js "
                    "and npm, then build the target <code>page</code> (<code>./run build</code>), or name their folder "
                    "with <code>--page</code>.");
    if (!file) return words(404, "there is nothing at " + target.path);
    Reply reply;
    reply.answer.type = file->type;
    auto& headers = reply.answer.headers;
    headers.emplace_back("Cache-Control", file->hashed ? "public, max-age=31536000, immutable" : "no-cache");
    headers.emplace_back("ETag", file->tag);
    if (view(request[http::field::if_none_match]).find(file->tag) != std::string_view::npos) {
      reply.answer.status = 304;
      return reply;
    }
    reply.file = file->body;
    if (!file->compressed.empty()) {
      headers.emplace_back("Vary", "Accept-Encoding");
      if (view(request[http::field::accept_encoding]).find("gzip") != std::string_view::npos) {
        headers.emplace_back("Content-Encoding", "gzip");
        reply.file = file->compressed;
      }
    }
    return reply;
  }

  /// What the server's thread alone knows for /metrics.
  std::string metrics() const {
    std::string text;
    const auto tell = [&](const std::string& name, const char* type, const char* help, double value) {
      const std::string full = "citylearn_dashboard_" + name;
      text += "# HELP " + full + " " + help + "\n# TYPE " + full + " " + type + "\n" + full + " " + number(value);
    };
    const auto counts = premises_.hub.counts();
    tell("connections", "gauge", "Open connections.", static_cast<double>(premises_.connections.size()));
    tell("connections_total", "counter", "Connections accepted.", static_cast<double>(premises_.accepted));
    tell("connections_refused_total", "counter", "Connections refused, as too many were busy.",
         static_cast<double>(premises_.refused));
    tell("connections_made_room_total", "counter", "Idle connections closed for newcomers.",
         static_cast<double>(premises_.connections.made_room()));
    tell("live_clients", "gauge", "WebSocket clients.", static_cast<double>(counts.clients));
    tell("live_messages_total", "counter", "Messages published that somebody watched.",
         static_cast<double>(counts.published));
    tell("live_frames_total", "counter", "Frames taken by WebSocket clients.", static_cast<double>(counts.taken));
    tell("live_dropped_total", "counter", "Messages (of training: rows) that WebSocket clients lost.",
         static_cast<double>(counts.dropped));
    tell("live_bytes_total", "counter", "Bytes of the frames sent.", static_cast<double>(premises_.frame_bytes));
    tell("live_let_go_total", "counter", "WebSocket clients closed as they took or said nothing.",
         static_cast<double>(premises_.let_go));
    tell("live_broken_total", "counter", "WebSocket clients closed for malformed frames or messages.",
         static_cast<double>(premises_.broken));
    const std::string requests = "citylearn_dashboard_requests_total";
    text += "# HELP " + requests + " Requests answered, by status.\n# TYPE " + requests + " counter\n";
    for (const auto& [status, count] : premises_.answers)
      text += requests + "{status=\"" + std::to_string(status) + "\"} " + std::to_string(count) + "\n";
    rusage used{};
    getrusage(RUSAGE_SELF, &used);
    const auto seconds = [](const timeval& t) { return double(t.tv_sec) + double(t.tv_usec) * 1e-6; };
    text +=
        "# HELP process_cpu_seconds_total User and system time.\n# TYPE process_cpu_seconds_total counter\n"
        "process_cpu_seconds_total " +
        number(seconds(used.ru_utime) + seconds(used.ru_stime));
    return text;
  }

 private:
  static std::string number(double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.15g\n", value);
    return text;
  }

  Reply login(const Request& request, const Target& target) {
    Access& access = *premises_.access;
    Reply home = letter(303, "Welcome", "The dashboard is at <a href=\"/\">/</a>.");
    home.answer.headers.emplace_back("Location", "/");
    if (!access.needs_token()) return home;
    const auto code = target.parameters.find("once");
    if (code == target.parameters.end()) {
      // For the page, which asks for the token: from then on the WebSocket has the cookie.
      if (!access.knows(credentials(request))) return words(401, "this needs 'Authorization: Bearer TOKEN'");
      Reply reply;
      reply.answer.status = 204;
      reply.answer.headers.emplace_back("Set-Cookie", access.cookie());
      return reply;
    }
    if (request.method() != http::verb::get) return words(405, "a link is used with GET");
    if (!access.redeem(code->second)) {
      spdlog::warn("a login link was refused: wrong, or used before");
      return letter(401, "This link is not valid",
                    "It works once. The token itself opens the dashboard too: it is in the token file.");
    }
    home.answer.headers.emplace_back("Set-Cookie", access.cookie());
    return home;
  }

  Premises& premises_;
};

// GCC 12 destroys temporaries in a co_await's arguments twice when they are converted there (bug 99576 and its kin):
// what coroutines take has a name before.
using Call = std::function<Answer()>;

/// Answers an API call on a worker; goes on on the server's thread.
asio::awaitable<Answer> on_worker(Premises& premises, const Call& call) {
  const auto begin = [&premises, &call](auto handler) {
    asio::post(premises.workers, [&premises, call, handler = std::move(handler)]() mutable {
      Answer answer;
      try {
        answer = call();
      } catch (const std::exception& error) {
        spdlog::error("an API call failed: {}", error.what());
        answer = error_answer(500, error.what());
      }
      asio::post(premises.io,
                 [handler = std::move(handler), answer = std::move(answer)]() mutable { handler(std::move(answer)); });
    });
  };
  Answer answer =
      co_await asio::async_initiate<const asio::use_awaitable_t<>, void(Answer)>(begin, asio::use_awaitable);
  co_return answer;
}

template <class Stream>
class Session : public Connection, public std::enable_shared_from_this<Session<Stream>> {
 public:
  Session(Premises& premises, Stream stream)
      : premises_(premises),
        desk_(premises),
        stream_(std::move(stream)),
        buffer_(premises.options.header_bytes + premises.options.body_bytes),
        news_(premises.io) {
    error_code none;
    address = socket().remote_endpoint(none).address();
    deadline = since + premises.options.request_time;
    premises_.connections.add(*this);
  }
  ~Session() override { premises_.connections.remove(*this); }

  void begin() {
    asio::co_spawn(
        premises_.io, [self = this->shared_from_this()] { return self->run(); }, asio::detached);
  }

  void close() override {
    premises_.connections.remove(*this);
    error_code none;
    socket().close(none);
    news_.cancel();
    ended_ = true;
  }

  void tick(Time at) override {
    if (!live_ || !live_->is_open()) return;
    const auto patience = premises_.options.patience;
    if (at - heard_ > patience || at - writing_ > patience) {  // either may be the end of time
      ++premises_.let_go;
      close();
    } else if (next_ping_ <= at && !pinging_) {
      next_ping_ = at + premises_.options.ping;
      pinging_ = true;
      live_->async_ping({}, [self = this->shared_from_this()](error_code) { self->pinging_ = false; });
    }
  }

 private:
  tcp::socket& socket() { return live_ ? beast::get_lowest_layer(*live_) : beast::get_lowest_layer(stream_); }
  static constexpr bool kTls = !std::is_same_v<Stream, tcp::socket>;

  asio::awaitable<void> run() {
    error_code error;
    // Nothing is allocated, and no TLS begun, for those who connect and say nothing.
    co_await socket().async_wait(tcp::socket::wait_read, with(error));
    if (error) co_return;
    if constexpr (kTls) {
      co_await stream_.async_handshake(asio::ssl::stream_base::server, with(error));
      if (error) co_return;
    }
    bool more = true;
    while (more && !ended_) more = co_await exchange();
  }

  /// One request and its answer; false when it was the last.
  asio::awaitable<bool> exchange() {
    idle = true;
    since = now();
    deadline = since + premises_.options.request_time;
    http::request_parser<http::string_body> parser;
    parser.header_limit(premises_.options.header_bytes);
    parser.body_limit(premises_.options.body_bytes);
    error_code error;
    co_await http::async_read_header(stream_, buffer_, parser, with(error));
    idle = false;
    const auto target = error ? std::nullopt : parse_target(view(parser.get().target()));
    if (!error) {
      const std::optional<Reply> refusal = desk_.refusal(parser.get(), target);
      if (refusal) co_return co_await send(*refusal, parser.get(), parser.is_done() && parser.get().keep_alive());
      if (!parser.is_done()) co_await http::async_read(stream_, buffer_, parser, with(error));
    }
    if (error) {
      const std::optional<Reply> complaint = complaint_of(error);
      if (complaint) co_await send(*complaint, parser.get(), false);
      co_return false;
    }
    const Request request = parser.release();
    if (target->path == "/api/live") {
      if (websocket::is_upgrade(request)) {
        co_await live(request);
        co_return false;
      }
      const Reply reply = words(400, "a WebSocket is spoken here");
      co_return co_await send(reply, request, request.keep_alive());
    }
    Reply reply;
    if (target->segments[0] == "api")
      reply = co_await api(request, *target);
    else if (target->path == "/metrics")
      reply = co_await metrics();
    else
      reply = desk_.reply(request, *target);
    co_return co_await send(reply, request, request.keep_alive());
  }

  /// Nothing for a connection that just ended.
  std::optional<Reply> complaint_of(const error_code& error) const {
    const ServerOptions& options = premises_.options;
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return words(431, "the header is larger than " + std::to_string(options.header_bytes) + " bytes");
    if (error == http::error::body_limit)
      return words(413, "the body is larger than " + std::to_string(options.body_bytes) + " bytes");
    if (error == http::error::end_of_stream || error == http::error::partial_message) return std::nullopt;
    if (error.category() != http::make_error_code(http::error::bad_method).category()) return std::nullopt;
    return words(400, "this is no HTTP: " + error.message());
  }

  asio::awaitable<Reply> api(const Request& request, const Target& target) {
    Query query;
    if (request.method() == http::verb::delete_) query.method = "DELETE";
    query.path.assign(target.segments.begin() + 1, target.segments.end());
    query.parameters = target.parameters;
    const Call call = [this, query] { return premises_.handlers.api(query); };
    co_return co_await asked(call);
  }

  asio::awaitable<Reply> metrics() {
    Answer answer;
    answer.type = "text/plain; version=0.0.4; charset=utf-8";
    answer.body = desk_.metrics();
    if (!premises_.handlers.metrics) co_return Reply{answer, {}};
    const Call call = [this, answer]() mutable {
      answer.body += premises_.handlers.metrics();
      return answer;
    };
    co_return co_await asked(call);
  }

  asio::awaitable<Reply> asked(const Call& call) {
    if (premises_.asked >= premises_.options.waiting) {
      Reply reply = words(503, "too many requests wait already");
      reply.answer.headers.emplace_back("Retry-After", "1");
      co_return reply;
    }
    ++premises_.asked;
    deadline = Time::max();  // the time is ours now
    Answer answer = co_await on_worker(premises_, call);
    --premises_.asked;
    co_return Reply{std::move(answer), {}};
  }

  /// True when the connection goes on.
  asio::awaitable<bool> send(const Reply& reply, const Request& request, bool keep) {
    const Answer& answer = reply.answer;
    const std::string_view body = reply.file.empty() ? std::string_view(answer.body) : reply.file;
    const bool bodiless = answer.status == 204 || answer.status == 304;
    ++premises_.answers[answer.status];
    Response response;
    response.version(request.version() == 10 ? 10 : 11);
    response.result(static_cast<unsigned>(answer.status));
    put_strict_headers(response);
    response.set(http::field::date, http_date());
    for (const auto& [name, value] : answer.headers) response.set(name, one_line(value));
    if (!bodiless) {
      response.set(http::field::content_type, answer.type);
      response.content_length(body.size());
      if (request.method() != http::verb::head) response.body() = beast::span<const char>(body.data(), body.size());
    }
    response.keep_alive(keep);
    http::response_serializer<http::span_body<const char>> serializer(response);
    error_code error;
    while (!error && !serializer.is_done()) {
      deadline = now() + premises_.options.request_time;
      co_await http::async_write_some(stream_, serializer, with(error));
    }
    if (!error && !keep) co_await linger();
    co_return !error && keep;
  }

  /// A connection closed while bytes of the client are on their way is reset, and our last words are lost. So they are
  /// taken for a moment.
  asio::awaitable<void> linger() {
    error_code error;
    socket().shutdown(tcp::socket::shutdown_send, error);
    idle = true;
    since = now();
    deadline = since + std::min<std::chrono::milliseconds>(premises_.options.request_time, kLingerTime);
    std::string waste(16 << 10, '\0');
    for (std::size_t taken = 0; !error && taken < kLingerBytes;) {
      const std::size_t count = co_await socket().async_read_some(asio::buffer(waste), with(error));
      taken += count;
    }
  }

  asio::awaitable<void> live(const Request& request) {
    error_code error;
    socket().set_option(asio::socket_base::send_buffer_size(kSendBuffer), error);
    deadline = now() + premises_.options.request_time;
    live_.emplace(std::move(stream_));
    live_->auto_fragment(false);
    live_->read_message_max(premises_.options.message_bytes);
    live_->binary(true);
    live_->set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      put_strict_headers(response);
      response.set(http::field::server, "citylearn");  // else Beast puts its own there
    }));
    live_->control_callback([this](websocket::frame_type kind, beast::string_view) {
      heard_ = now();
      if (kind != websocket::frame_type::close) return;
      deadline = heard_ + kLingerTime;  // to take our farewell
      client_->watch({});
    });
    co_await live_->async_accept(request, with(error));
    if (error) co_return;
    ++premises_.answers[101];
    deadline = Time::max();
    heard_ = now();
    next_ping_ = heard_ + premises_.options.ping;
    client_ = premises_.hub.join([&io = premises_.io, session = this->weak_from_this()] {
      asio::post(io, [session] {
        if (const auto self = session.lock()) self->news_.cancel();
      });
    });
    asio::co_spawn(
        premises_.io, [self = this->shared_from_this()] { return self->write_frames(); }, asio::detached);
    beast::flat_buffer said;
    for (;;) {
      said.clear();
      co_await live_->async_read(said, with(error));
      if (error) break;
      heard_ = now();
      const auto topics = live_->got_text() ? parse_watch(beast::buffers_to_string(said.data()))
                                            : std::optional<std::set<std::string>>();
      if (!topics) {
        ++premises_.broken;
        deadline = now() + kLingerTime;
        const websocket::close_reason reason(websocket::close_code::policy_error,
                                             R"(say {"watch": [at most 64 topics]})");
        co_await live_->async_close(reason, with(error));
        break;
      }
      client_->watch(*topics);
    }
    if (error.category() == websocket::make_error_code(websocket::error::closed).category() &&
        error != websocket::error::closed)
      ++premises_.broken;
    close();
  }

  asio::awaitable<void> write_frames() {
    error_code error;
    while (!error && !ended_) {
      const std::optional<ClientHub::Frame> frame = client_->next();
      if (!frame) {
        error_code woken;
        news_.expires_at(Time::max());
        co_await news_.async_wait(with(woken));
        continue;
      }
      const std::array<asio::const_buffer, 2> parts = {asio::buffer(frame->head), asio::buffer(*frame->payload)};
      writing_ = now();
      const std::size_t bytes = co_await live_->async_write(parts, with(error));
      premises_.frame_bytes += bytes;
      writing_ = Time::max();
    }
    client_->watch({});  // nobody takes it any more
  }

  Premises& premises_;
  Desk desk_;
  Stream stream_;
  beast::flat_buffer buffer_;
  bool ended_ = false;

  // Of a WebSocket.
  std::optional<websocket::stream<Stream>> live_;
  std::shared_ptr<ClientHub::Client> client_;
  asio::steady_timer news_;  // never fires; cancelled when there is something to write
  Time heard_ = Time::max(), writing_ = Time::max(), next_ping_ = Time::max();
  bool pinging_ = false;
};

}  // namespace

void serve(Premises& premises, tcp::socket socket) {
  if (premises.tls) {
    using Stream = beast::ssl_stream<tcp::socket>;
    std::make_shared<Session<Stream>>(premises, Stream(std::move(socket), *premises.tls))->begin();
  } else {
    std::make_shared<Session<tcp::socket>>(premises, std::move(socket))->begin();
  }
}

}  // namespace citylearn
