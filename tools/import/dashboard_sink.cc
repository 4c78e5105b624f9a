// SPDX-License-Identifier: Apache-2.0
#include "tools/import/dashboard_sink.h"

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <variant>

#include "core/files/json.h"
#include "core/util/error.h"
#include "dashboard/api/log_frame.h"
#include "dashboard/http/answer.h"

namespace citylearn {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using Json = nlohmann::json;

constexpr std::chrono::seconds kPatience{60};

std::string quoted(const std::string& text) { return text_of(Json(text)); }

std::string percent_encoded(const std::string& text) {
  std::string encoded;
  for (const unsigned char c : text) {
    char code[4];
    std::snprintf(code, sizeof code, "%%%02X", c);
    encoded += std::isalnum(c) || c == '-' || c == '_' || c == '.' ? std::string(1, static_cast<char>(c)) : code;
  }
  return encoded;
}

/// Returns the record of a batch that has no points; empty: it has none.
std::string other_record(const LogBatch& batch) {
  if (batch.beginning()) {
    const LogBeginning& begins = *batch.beginning();
    const Json json = {
        {"begin",
         {{"started", begins.started}, {"title", begins.title}, {"tags", begins.tags}, {"note", begins.note}}}};
    return text_of(json);
  }
  if (!batch.config().empty()) return "{\"config\":" + batch.config().front() + "}";
  if (!batch.summary().empty()) return "{\"summary\":" + batch.summary().front() + "}";
  return "";
}

}  // namespace

struct DashboardSink::Impl {
  std::string url, host, port, token;
  bool tls = false;
  asio::io_context io;
  asio::ssl::context trust{asio::ssl::context::tls_client};
  using Plain = beast::tcp_stream;
  using Secure = asio::ssl::stream<beast::tcp_stream>;
  std::variant<std::monostate, Plain, Secure> stream;
  beast::flat_buffer buffer;

  void connect() {
    const auto found = tcp::resolver(io).resolve(host, port);
    if (!tls) {
      stream.emplace<Plain>(io).connect(found);
      return;
    }
    Secure& secure = stream.emplace<Secure>(io, trust);
    if (!SSL_set_tlsext_host_name(secure.native_handle(), host.c_str())) throw Error("has no TLS", url);
    secure.set_verify_callback(asio::ssl::host_name_verification(host));
    beast::get_lowest_layer(secure).connect(found);
    secure.handshake(asio::ssl::stream_base::client);
  }

  template <class Stream>
  http::response<http::string_body> exchange(Stream& to, http::request<http::string_body>& request) {
    beast::get_lowest_layer(to).expires_after(kPatience);
    http::write(to, request);
    http::response<http::string_body> response;
    http::read(to, buffer, response);
    return response;
  }

  LoggedRuns::Outcome post(const std::string& id, std::string body, const char* type) {
    http::request<http::string_body> request(http::verb::post, "/api/runs/" + percent_encoded(id), 11, std::move(body));
    request.set(http::field::host, host + ":" + port);
    request.set(http::field::content_type, type);
    if (!token.empty()) request.set(http::field::authorization, "Bearer " + token);
    request.prepare_payload();
    http::response<http::string_body> response;
    try {
      if (stream.index() == 0) connect();
      response = stream.index() == 1 ? exchange(std::get<Plain>(stream), request)
                                     : exchange(std::get<Secure>(stream), request);
    } catch (const boost::system::system_error& error) {
      throw Error("does not answer: " + error.code().message(), url, "is it the dashboard's address?");
    }
    const Json answer = parse_json_or_null(response.body());
    if (response.result() == http::status::conflict) return {0, true};
    if (response.result() != http::status::ok || !answer.is_object() || !answer.contains("received")) {
      const std::string said = answer.is_object() ? answer.value("error", "") : "";
      throw Error("refuses: " + (said.empty() ? "status " + std::to_string(response.result_int()) : said), url);
    }
    return {answer["received"].get<std::uint64_t>(), false};
  }
};

DashboardSink::DashboardSink(const std::string& url, std::string token) : impl_(std::make_unique<Impl>()) {
  Impl& impl = *impl_;
  impl.url = url;
  impl.token = std::move(token);
  std::string_view rest = url;
  impl.tls = rest.starts_with("https://");
  const bool plain = rest.starts_with("http://");
  if (!impl.tls && !plain) throw Error("is not an address", "--dashboard " + url, "for example http://127.0.0.1:8080");
  rest.remove_prefix(impl.tls ? 8 : 7);
  rest = rest.substr(0, rest.find('/'));
  const std::size_t colon = rest.rfind(':');
  const bool has_port = colon != rest.npos && rest.find(']', colon) == rest.npos;
  impl.host = rest.substr(0, has_port ? colon : rest.npos);
  impl.port = has_port ? std::string(rest.substr(colon + 1)) : impl.tls ? "443" : "80";
  impl.trust.set_default_verify_paths();
  impl.trust.set_verify_mode(asio::ssl::verify_peer);
}
DashboardSink::~DashboardSink() = default;

LoggedRuns::Outcome DashboardSink::append(const std::string& id, const LogBatch& batch) {
  const std::vector<LoggedPoint>& points = batch.points();
  if (points.empty()) {
    std::string body = "{\"source\":" + quoted(batch.source) + ",\"log\":" + quoted(batch.log) +
                       ",\"first\":" + std::to_string(batch.first()) + ",\"records\":[" + other_record(batch) + "]";
    if (batch.ended) body += std::string(",\"ended\":") + (*batch.ended ? "true" : "false");
    return impl_->post(id, body + "}", "application/json");
  }
  LoggedRuns::Outcome outcome;
  for (std::size_t from = 0; from < points.size() && !outcome.other_log;) {
    std::size_t to = std::min(from + kPointsOfFrame, points.size());
    while (to < points.size() && points[to].record == points[to - 1].record) ++to;
    outcome = impl_->post(id, log_frame(batch, from, to, to == points.size()), kLogFrameType);
    from = to;
  }
  return outcome;
}

}  // namespace citylearn
