# SPDX-License-Identifier: Apache-2.0
# Reads a safetensors file by the format's description alone, with none of the project's code:
# https://github.com/huggingface/safetensors#format. Prints "meta KEY VALUE" and "NAME SHAPE BITS...", the numbers as
# the bits of their 32-bit floats, and dies where the file breaks a rule.
use strict;
use warnings;
use JSON::PP;

open(my $file, '<:raw', $ARGV[0]) or die "$ARGV[0]: $!\n";
my $bytes = do { local $/; <$file> };
my $length = unpack('Q<', substr($bytes, 0, 8));
die "header of $length bytes\n" if 8 + $length > length $bytes;
my $text = substr($bytes, 8, $length);
die "the header does not begin with {\n" unless substr($text, 0, 1) eq '{';
my $header = decode_json($text);
my $data = substr($bytes, 8 + $length);

my $metadata = delete $header->{__metadata__} // {};
print "meta $_ $metadata->{$_}\n" for sort keys %$metadata;
my $at = 0;
for my $name (sort { $header->{$a}{data_offsets}[0] <=> $header->{$b}{data_offsets}[0] } keys %$header) {
  my ($begin, $end) = @{$header->{$name}{data_offsets}};
  die "$name: $header->{$name}{dtype}\n" unless $header->{$name}{dtype} eq 'F32';
  die "$name: begins at $begin, not $at\n" unless $begin == $at;
  my $count = 1;
  $count *= $_ for @{$header->{$name}{shape}};
  die "$name: shape and offsets differ\n" unless $end - $begin == 4 * $count;
  print "$name ", join('x', @{$header->{$name}{shape}}), ' ',
      join(' ', unpack('L<*', substr($data, $begin, $end - $begin))), "\n";
  $at = $end;
}
die "bytes left over\n" unless $at == length $data;
