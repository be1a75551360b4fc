// The beacons workload on ns-3's lr-wpan: every node broadcasts 12 bytes once a second, at a phase of its own.
//
//   beacons NODES METRES SECONDS CULL [LOSS] -> one line of JSON
//
// NODES uniform on a square of side METRES; whoever stands within 75 m receives at the sender's power, nobody else
// anything; unslotted CSMA/CA, 16-bit addresses, no log. CULL: "culled" if the channel is to leave out who is too far
// away (the attribute MaxLossDb; it still works out the loss to everybody), "all" if everybody is told of each frame.
// LOSS: "range" (what is said above, the default), or "log_distance": the loss grows with the logarithm of the distance,
// with the exponent and the loss at 1 m of our link `log_normal`. The sensitivity of this PHY is fixed at -106.58 dBm; what
// it is better than ours is added to the loss, so that both receive over the same distance, 46 m.
// In ns-3 a frame that is hit by another of equal power may survive it (its error model knows the spreading gain).

#include "ns3/constant-position-mobility-model.h"
#include "ns3/core-module.h"
#include "ns3/lr-wpan-module.h"
#include "ns3/node-container.h"
#include "ns3/packet.h"
#include "ns3/propagation-delay-model.h"
#include "ns3/propagation-loss-model.h"
#include "ns3/single-model-spectrum-channel.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <vector>

using namespace ns3;

namespace
{
constexpr double REACH = 75.0;
constexpr double PERIOD = 1.0;
constexpr uint32_t PAYLOAD = 12;
constexpr double TOO_WEAK = 200.0; // dB: RangePropagationLossModel takes 1000 off what is out of range

constexpr double EXPONENT = 2.4;
constexpr double BETTER = 106.58 - 95.0;       // dB: the sensitivity of this PHY above that of ours
constexpr double LOSS_AT_1M = 55.0 + BETTER;   // dB
constexpr double UNHEARD = 106.58 + 3.0;       // dB: at this loss hardly any frame arrives

struct Tally
{
    uint64_t offered = 0, sent = 0, inRange = 0, delivered = 0;
    uint32_t bytes = 0;
};

Tally tally;
std::vector<uint32_t> neighbours;

double CpuSeconds()
{
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

Ptr<PropagationLossModel> MakeLoss(const std::string& name)
{
    if (name == "log_distance")
    {
        auto loss = CreateObject<LogDistancePropagationLossModel>();
        loss->SetPathLossExponent(EXPONENT);
        loss->SetReference(1.0, LOSS_AT_1M);
        return loss;
    }
    auto loss = CreateObject<RangePropagationLossModel>();
    loss->SetAttribute("MaxRange", DoubleValue(REACH));
    return loss;
}

Ptr<SingleModelSpectrumChannel> MakeChannel(const std::string& cull, const std::string& loss)
{
    auto channel = CreateObject<SingleModelSpectrumChannel>();
    channel->AddPropagationLossModel(MakeLoss(loss));
    channel->SetPropagationDelayModel(CreateObject<ConstantSpeedPropagationDelayModel>());
    if (cull == "culled")
    {
        channel->SetAttribute("MaxLossDb", DoubleValue(loss == "range" ? TOO_WEAK : UNHEARD));
    }
    return channel;
}

NodeContainer Deploy(uint32_t count, double side)
{
    NodeContainer nodes;
    nodes.Create(count);
    auto draw = CreateObject<UniformRandomVariable>();
    for (uint32_t i = 0; i < count; ++i)
    {
        auto place = CreateObject<ConstantPositionMobilityModel>();
        place->SetPosition(Vector(draw->GetValue(0.0, side), draw->GetValue(0.0, side), 0.0));
        nodes.Get(i)->AggregateObject(place);
    }
    return nodes;
}

void CountNeighbours(const NodeContainer& nodes)
{
    neighbours.assign(nodes.GetN(), 0);
    for (uint32_t i = 0; i < nodes.GetN(); ++i)
    {
        auto place = nodes.Get(i)->GetObject<MobilityModel>();
        for (uint32_t j = i + 1; j < nodes.GetN(); ++j)
        {
            if (place->GetDistanceFrom(nodes.Get(j)->GetObject<MobilityModel>()) <= REACH)
            {
                ++neighbours[i];
                ++neighbours[j];
            }
        }
    }
}

void Beacon(Ptr<LrWpanMac> mac)
{
    McpsDataRequestParams request;
    request.m_srcAddrMode = SHORT_ADDR;
    request.m_dstAddrMode = SHORT_ADDR;
    request.m_dstPanId = mac->GetPanId();
    request.m_dstAddr = Mac16Address("ff:ff");
    ++tally.offered;
    mac->McpsDataRequest(request, Create<Packet>(PAYLOAD));
    Simulator::Schedule(Seconds(PERIOD), &Beacon, mac);
}

void OnAir(uint32_t node, Ptr<const Packet> frame)
{
    ++tally.sent;
    tally.inRange += neighbours[node];
    tally.bytes = frame->GetSize();
}

void Received(McpsDataIndicationParams, Ptr<Packet>)
{
    ++tally.delivered;
}

void Connect(const NetDeviceContainer& devices)
{
    auto phase = CreateObject<UniformRandomVariable>();
    for (uint32_t i = 0; i < devices.GetN(); ++i)
    {
        auto device = DynamicCast<LrWpanNetDevice>(devices.Get(i));
        char address[8];
        std::snprintf(address, sizeof address, "%02x:%02x", (i + 1) >> 8 & 0xff, (i + 1) & 0xff);
        device->GetMac()->SetShortAddress(Mac16Address(address));
        device->GetMac()->SetPanId(1);
        device->GetMac()->SetMcpsDataIndicationCallback(MakeCallback(&Received));
        device->GetPhy()->TraceConnectWithoutContext("PhyTxBegin", MakeBoundCallback(&OnAir, i));
        Simulator::ScheduleWithContext(i, Seconds(phase->GetValue(0.0, PERIOD)), &Beacon, device->GetMac());
    }
}
} // namespace

int main(int argc, char* argv[])
{
    if (argc != 5 && argc != 6)
    {
        std::fprintf(stderr, "usage: %s NODES METRES SECONDS culled|all [range|log_distance]\n", argv[0]);
        return 2;
    }
    const uint32_t count = std::strtoul(argv[1], nullptr, 10);
    const double side = std::atof(argv[2]), seconds = std::atof(argv[3]);
    const double began = CpuSeconds();
    auto nodes = Deploy(count, side);
    CountNeighbours(nodes);
    LrWpanHelper helper;
    helper.SetChannel(MakeChannel(argv[4], argc == 6 ? argv[5] : "range"));
    Connect(helper.Install(nodes));
    const double built = CpuSeconds();
    Simulator::Stop(Seconds(seconds));
    Simulator::Run();
    const double ended = CpuSeconds();
    std::printf("{\"offered\": %lu, \"sent\": %lu, \"in_range\": %lu, \"delivered\": %lu, \"bytes\": %u, "
                "\"construct\": %.6f, \"cpu\": %.6f}\n",
                tally.offered, tally.sent, tally.inRange, tally.delivered, tally.bytes, built - began, ended - built);
    Simulator::Destroy();
    return 0;
}
